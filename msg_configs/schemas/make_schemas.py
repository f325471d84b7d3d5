"""Write the MCAP schemas of all topics from an installed ROS 2. ``./dragon schemas`` runs this script.

A schema is the ros2msg text of a type, followed by the texts of the types that it contains, as stored by rosbag2.
``types.yaml`` contains the type hashes. With these files, bags can be written without ROS.
"""
import json
import re
from pathlib import Path

import yaml
from ament_index_python.packages import get_package_share_directory

from dragon_ros.messages.channels import channels

_PRIMITIVE = re.compile(r'(bool|byte|char|u?int\d+|float\d+|w?string)\b')


def definition(name: str) -> str:
    """Return the text of a type such as geometry_msgs/msg/Pose."""
    package, _, kind = name.split('/')
    return (Path(get_package_share_directory(package)) / 'msg' / f'{kind}.msg').read_text()


def parts(name: str) -> list[str]:
    """Return the types of the fields of a type, in order."""
    package, found = name.split('/')[0], []
    for line in definition(name).splitlines():
        kind = re.split(r'[\s\[]', line.split('#')[0].strip())[0].split('<')[0]
        if kind and not _PRIMITIVE.match(kind):
            whole = kind.split('/') if '/' in kind else [package, kind]
            found.append(f'{whole[0]}/msg/{whole[-1]}')
    return found


def schema(name: str) -> str:
    """Return the text of a type and of all types that it contains, each once."""
    todo, done = [name], []
    while todo:
        current = todo.pop(0)
        if current not in done:
            done.append(current)
            todo += parts(current)
    rest = [f'{"=" * 80}\nMSG: {part.replace("/msg/", "/")}\n{definition(part)}' for part in done[1:]]
    return '\n'.join([definition(name), *rest])


def type_hash(name: str) -> str:
    """Return the RIHS01 hash of a type."""
    package, _, kind = name.split('/')
    described = json.loads((Path(get_package_share_directory(package)) / 'msg' / f'{kind}.json').read_text())
    return next(row['hash_string'] for row in described['type_hashes'] if row['type_name'] == name)


def main() -> None:
    """Write one file per type, and the hashes."""
    here = Path(__file__).parent
    types = sorted({channel.type for channel in channels().values()})
    for name in types:
        (here / f'{name.replace("/msg/", ".")}.msg').write_text(schema(name))
    (here / 'types.yaml').write_text(yaml.safe_dump({name: type_hash(name) for name in types}))


if __name__ == '__main__':
    main()
