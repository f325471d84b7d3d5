"""Install dragon_ros: with colcon on a ROS 2 install, or with pip beside the ROS 2 wheels."""
from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

NAME = 'dragon_ros'
HERE = Path(__file__).resolve().parent      # colcon --symlink-install runs a link to this file
MANIFEST = ElementTree.parse(HERE / 'package.xml').getroot()        # which has the addresses


def files(folder: str, pattern: str = '*') -> list[str]:
    """Return the files of a folder, sorted, as paths relative to the folder of this file."""
    return sorted(path.as_posix() for path in Path(folder).glob(pattern) if path.is_file() and path.suffix != '.py')


def executables() -> list[str]:
    """Return the scripts of the executables, without those of packages that are absent."""
    absent = {name for folder, name in (('dragon_contest', 'grade'), ('dragon_studies', 'study'))
              if not Path(folder).is_dir()}
    return [path for path in files('scripts') if Path(path).name not in absent]


def configuration() -> list[tuple[str, list[str]]]:
    """Return every folder below msg_configs with its files, for installation in share/."""
    folders = [Path('msg_configs'), *sorted(path for path in Path('msg_configs').rglob('*') if path.is_dir())]
    return [(f'share/{NAME}/{folder.as_posix()}', files(folder.as_posix())) for folder in folders]


setup(
    name=NAME,
    version='0.4.0',
    description='Bench dragon simulator for ROS 2',
    long_description=(HERE / 'README.md').read_text(encoding='utf-8'),
    long_description_content_type='text/markdown',
    classifiers=['Development Status :: 4 - Beta', 'Intended Audience :: Education',
                 'Intended Audience :: Science/Research',
                 'Operating System :: POSIX :: Linux', 'Programming Language :: Python :: 3',
                 'Topic :: Scientific/Engineering'],
    url=MANIFEST.findtext('url'),
    license='Apache-2.0',
    maintainer='dragon_ros maintainers',
    maintainer_email=MANIFEST.find('maintainer').attrib['email'],
    packages=find_packages(include=[NAME, f'{NAME}.*', 'dragon_contest', 'dragon_contest.*', 'dragon_studies']),
    package_data={NAME: ['py.typed'], f'{NAME}.commands.view': ['web/*'],
                  'dragon_contest': ['paper_tables.json'], 'dragon_contest.grade': ['report.css']},
    # Executables are data files: `ros2 run` searches lib/dragon_ros, and names such as `sim` must never be installed in
    # a bin/.
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'lib/{NAME}', executables()),
        (f'share/{NAME}/launch', ['launch/dragon.launch.py']),
        *configuration(),
    ],
    # The only name that pip installs in its bin/; colcon puts it beside the executables.
    entry_points={'console_scripts': ['dragon = dragon_ros.__main__:dragon']},
    python_requires='>=3.11',
    # ROS packages come with ROS (or from requirements.txt). ROS packages are not listed here, since that would break an
    # ordinary install.
    install_requires=['argcomplete>=3.1', 'lz4>=4.0', 'matplotlib>=3.6', 'mcap>=1.1', 'numpy>=1.26', 'PyYAML>=6.0',
                      'regex>=2022.10', 'shapely>=2.0', 'tqdm>=4.66', 'zstandard>=0.22'],
    extras_require={'cost': ['mpmath>=1.2'], 'maps': ['pyproj>=3.6'], 'parquet': ['pyarrow>=15'],
                    'svg': ['svgelements>=1.9.6'], 'xlsx': ['openpyxl>=3.1.5'],
                    'grade': ['openpyxl>=3.1.5', 'python-calamine>=0.4'], 'verify': ['python-flint>=0.6'],
                    'study': ['pyarrow>=15', 'scipy>=1.15'],
                    'cluster': ['dask>=2026.8', 'distributed>=2026.8', 'pyarrow>=15', 'scipy>=1.15'],
                    'test': ['hypothesis', 'jsonschema>=4.10', 'mpmath>=1.2', 'pytest>=7.4', 'pytest-xdist>=3.4']},
    zip_safe=False,
)
