"""Build of the package, for pip and for colcon."""

import re
from pathlib import Path

from setuptools import find_packages, setup

NAME = 'rsmb_ros'
SHARED = ('launch', 'config', 'bags')  # folders below share/rsmb_ros


def version() -> str:
    """Read the version without importing the package, whose dependencies may be missing."""
    text = Path(NAME, '__init__.py').read_text()
    return re.search(r"^__version__ = '(.+)'$", text, re.MULTILINE)[1]


def shared_files() -> list[tuple[str, list[str]]]:
    """Return (target folder, files) for every folder in or below `SHARED`."""
    files = [path for folder in SHARED for path in Path(folder).rglob('*') if path.is_file()]
    kept = [path for path in files if '__pycache__' not in path.parts]
    folders = sorted({path.parent for path in kept})
    return [
        (f'share/{NAME}/{folder}', [str(path) for path in sorted(kept) if path.parent == folder])
        for folder in folders
    ]


setup(
    name=NAME,
    version=version(),
    description='Registration and change detection under rolling-shutter motion blur (RSMB)',
    license='Apache-2.0',
    python_requires='>=3.10',
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    package_data={f'{NAME}.ros': ['*.xml'], f'{NAME}.report': ['templates/*']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        *shared_files(),
        (f'lib/{NAME}', ['scripts/rsmb', 'scripts/rsmb_node']),
    ],
    entry_points={
        'console_scripts': [
            'rsmb = rsmb_ros.cli.main:main',
            'rsmb_node = rsmb_ros.ros.main:main',
        ]
    },
    zip_safe=False,
    install_requires=[
        'jinja2>=3.0',
        'lz4>=4.0',
        'mcap>=1.1',
        'numba>=0.58',
        'numpy>=1.26',
        'opencv-python-headless>=4.6',
        'pyyaml>=6.0',
        'rich>=13.0',
        'rosbags>=0.11',
        'scikit-image>=0.22',
        'scikit-learn>=1.4',
        'scipy>=1.11',
        'threadpoolctl>=3.1',
        'zstandard>=0.22',
    ],
    extras_require={
        # Wheels of ROS 2 Jazzy for machines without ROS; a robot has the apt packages instead.
        'ros': [
            'ros-jazzy-ament-index-python',
            'ros-jazzy-diagnostic-msgs',
            'ros-jazzy-rclpy[fastrtps]',
            'ros-jazzy-sensor-msgs',
            'ros-jazzy-std-msgs',
            'ros-jazzy-std-srvs',
        ],
        # Clients that share no code with ROS, for the tests; like ROS' wheels they are few.
        'interop': [
            'cyclonedds>=11; python_version < "3.14" and platform_machine == "x86_64"',
            'rosless>=0.5; platform_machine == "x86_64"',
        ],
        'batch': ['distributed>=2022.12'],  # rsmb batch --scheduler; apt: python3-distributed
        'osqp': ['osqp>=1.0'],  # second solver of the row estimator
        # colcon runs pytest only if it is named here
        'test': [
            *('distributed>=2022.12', 'hypothesis>=6.80', 'osqp>=1.0'),
            *('pytest>=7.4', 'setuptools'),
        ],
        'docs': ['mkdocs>=1.6,<2', 'mkdocs-material>=9.6', 'pymdown-extensions>=10.0'],
        # One minor version each, so that a new rule does not break an old commit.
        'dev': ['mypy~=2.4.0', 'ruff~=0.17.0', 'types-PyYAML'],
    },
)
