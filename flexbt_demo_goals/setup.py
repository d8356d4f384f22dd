# SPDX-License-Identifier: BSD-3-Clause
from pathlib import Path

from setuptools import find_packages, setup

package_name = 'flexbt_demo_goals'


def share(directory: str, pattern: str) -> tuple[str, list[str]]:
    """Files of a source directory that are installed into the same directory of the package share."""
    return f'share/{package_name}/{directory}', sorted(str(file) for file in Path(directory).glob(pattern))


setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test', 'test.*']),
    package_data={package_name: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
        share('trees', '*.xml'),
        share('config', '*.yaml'),
        share('missions', '*.yaml'),
        share('launch', '*.launch.py'),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},  # colcon test looks for it
    zip_safe=True,
    maintainer='The FlexBT developers',
    maintainer_email='maintainers@flexbt.invalid',
    description='A robot plans its way to a goal, and plans anew where the world contradicts.',
    license='BSD-3-Clause',
    entry_points={
        'console_scripts': [
            'goals = flexbt_demo_goals.executables:goals',
        ],
        'flexbt.behaviors': [
            'reach_goal = flexbt_demo_goals.behavior.reach_goal:ReachGoal',
        ],
        'flexbt.bt_nodes': [
            'flexbt_demo_goals = flexbt_demo_goals.leaves:register',
        ],
    },
)
