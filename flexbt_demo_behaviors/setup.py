# SPDX-License-Identifier: BSD-3-Clause
from pathlib import Path

from setuptools import find_packages, setup

package_name = 'flexbt_demo_behaviors'
modules = Path(package_name)


def share(folder: str, *files: Path) -> tuple[str, list[str]]:
    """Files that are installed into a folder of the package share."""
    return f'share/{package_name}/{folder}', sorted(map(str, files))


setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test', 'test.*']),
    package_data={package_name: ['py.typed', 'goals/reach_goal.yaml', 'mission_night/check_room.yaml']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
        share('launch', *Path('launch').glob('*.launch.py')),
        *(
            share(demonstration, *(modules / demonstration).glob('*.xml'), *(modules / demonstration).glob('*.yaml'))
            for demonstration in ('goals', 'inspection', 'mission_night', 'nav2_robot', 'navigate', 'night_watch')
        ),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},  # colcon test looks for it
    zip_safe=True,
    maintainer='The FlexBT developers',
    maintainer_email='maintainers@flexbt.invalid',
    description='The demonstrations of FlexBT: behaviors, trees, worlds and launch files.',
    license='BSD-3-Clause',
    entry_points={
        'console_scripts': [
            'deliveries = flexbt_demo_behaviors.executables:deliveries',
            'demo = flexbt_demo_behaviors.executables:demo',
            'goals = flexbt_demo_behaviors.executables:goals',
            'nav2_robot = flexbt_demo_behaviors.executables:nav2_robot',
            'night_watch = flexbt_demo_behaviors.executables:night_watch',
        ],
        'flexbt.behaviors': [
            'ask_operator = flexbt_demo_behaviors.nav2_robot.behavior:AskOperator',
            'check_room = flexbt_demo_behaviors.mission_night:check_room.yaml',
            'inspect_site = flexbt_demo_behaviors.inspection.behaviors:InspectSite',
            'inspection = flexbt_demo_behaviors.inspection.behaviors:Inspection',
            'navigate = flexbt_demo_behaviors.navigate.behaviors:Navigate',
            'navigate_split = flexbt_demo_behaviors.navigate.behaviors:NavigateSplit',
            'night_watch = flexbt_demo_behaviors.night_watch.behavior:NightWatch',
            'reach_goal = flexbt_demo_behaviors.goals:reach_goal.yaml',
        ],
        'flexbt.states': [
            'inspection = flexbt_demo_behaviors.inspection.behaviors',
            'navigate = flexbt_demo_behaviors.navigate.behaviors',
            'night_watch = flexbt_demo_behaviors.night_watch.states',
        ],
        'flexbt.bt_nodes': ['flexbt_demo_behaviors = flexbt_demo_behaviors.goals.leaves:register'],
    },
)
