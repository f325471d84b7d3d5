"""``python -m dragon_ros.verify``."""
import sys

from dragon_ros.verify.command import main

sys.exit(main())
