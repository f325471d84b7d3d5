"""``python -m dragon_ros.verify``."""
import sys
from io import TextIOWrapper

from dragon_ros.verify.command import main

if isinstance(sys.stdout, TextIOWrapper):       # what the locale's encoding lacks is escaped, as on standard error
    sys.stdout.reconfigure(errors='backslashreplace')
sys.exit(main())
