"""Install gravity_comp_ros, by colcon (ament_python) or by pip."""

from glob import glob
import os

from setuptools import find_packages, setup

NAME = 'gravity_comp_ros'


def files(folder):
    """Return data_files entries that carry `folder` and its subfolders to share/."""
    entries = []
    for here, _, names in sorted(os.walk(folder)):
        paths = [os.path.join(here, name) for name in sorted(names)
                 if not name.startswith('.') and not name.endswith('.pyc')]
        if paths and '__pycache__' not in here:
            entries.append((os.path.join('share', NAME, here), paths))
    return entries


SIM = ['pin>=2.7']
BAGS = ['mcap>=1.1', 'zstandard>=0.21']
PARQUET = ['pyarrow>=14']
REPORT = ['bokeh>=3.4']
COMPLETION = ['shtab>=1.6']
MJCF = ['mujoco>=3.0']
FLEET = ['dask>=2024.1', 'distributed>=2024.1', 'cryptography>=41']
ROS = [
    'ros-jazzy-rclpy>=7.1',
    'ros-jazzy-rmw-fastrtps-cpp>=8.4',
    'ros-jazzy-common-interfaces>=5.3',
]
TEST = ['pytest>=7.4', 'pytest-timeout>=2.2', 'pytest-xdist>=3.5', 'hypothesis>=6.98',
        'pdoc>=14', 'playwright>=1.40', 'flake8>=7', 'flake8-import-order>=0.18',
        'flake8-quotes>=3.3', 'ruff>=0.5', 'rosbags>=0.10',
        'colcon-common-extensions>=0.3', 'colcon-ros>=0.5']

setup(
    name=NAME,
    version='0.1.0',
    description='Gravity compensation learned from joint states, for ROS 2 arms',
    author='gravity_comp_ros maintainers',
    author_email='maintainers@example.org',
    maintainer='gravity_comp_ros maintainers',
    maintainer_email='maintainers@example.org',
    license='Apache-2.0',
    python_requires='>=3.11',
    packages=find_packages(include=[NAME, NAME + '.*']),
    package_data={NAME: ['py.typed', 'report/*.js']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + NAME]),
        ('share/' + NAME, ['package.xml', *glob('LICENSE')]),
        *files('config'),
        *files('launch'),
        *files('bags'),
    ],
    install_requires=['setuptools', 'numpy>=1.26.4', 'scipy>=1.11.4', 'PyYAML>=6.0',
                      'rich>=13.3', 'defusedxml>=0.7'],
    extras_require={'bags': BAGS, 'completion': COMPLETION, 'fleet': FLEET, 'mjcf': MJCF,
                    'parquet': PARQUET, 'report': REPORT, 'ros': ROS, 'sim': SIM,
                    'test': TEST + BAGS + COMPLETION + FLEET + MJCF + PARQUET + REPORT + SIM},
    zip_safe=False,
    entry_points={
        'console_scripts': [
            'gravity_comp = gravity_comp_ros.cli:main',
            'gravity_comp_node = gravity_comp_ros.node.main:main',
        ],
        # Effects of other packages register in this group.
        'gravity_comp_ros.effects': [],
    },
)
