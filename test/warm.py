"""Fill the caches that each node would fill; the process that nodes are forked from imports this module last.

Nothing here depends on an environment or a folder, and nothing starts a thread. The model of the default scene is the
one of most scenes that tests run; without it, each ``sim`` would build its first tables again.
"""
import gc
import inspect
from contextlib import suppress
from importlib import import_module

import dragon_ros.__main__  # noqa: F401, every process imports it
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import tick
from dragon_ros.messages.channels import channels
from dragon_ros.scenes.provenance import versions

# Each package has an extension module, which rclpy loads when it first uses a message or a service of the package.
for package in ('builtin_interfaces', *(f'{name}_msgs' for name in (
        'diagnostic', 'geometry', 'nav', 'rosgraph', 'sensor', 'service', 'std', 'visualization')), 'rcl_interfaces',
        'std_srvs', 'type_description_interfaces'):
    with suppress(ImportError):     # not every distribution of ROS 2 has all of them
        import_module(f'.{package}_s__rosidl_typesupport_c', package)
channels()
versions()
default = Scene()
tick(default, compile_scene(default).last_tick)
tick(default, 0)
inspect.getmodule(inspect.currentframe())       # indexes all modules; a node's first log line looks up its caller there
gc.freeze()     # a collection in a forked process would copy the memory of all these objects
