# SPDX-License-Identifier: BSD-3-Clause
from pathlib import Path

from setuptools import find_packages, setup

package_name = 'flexbt_sim'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test', 'test.*']),
    package_data={package_name: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
        (
            'share/' + package_name + '/maps',
            sorted(str(file) for file in Path('maps').iterdir() if file.suffix in ('.yaml', '.png')),
        ),
        ('share/' + package_name + '/rviz', ['rviz/robot.rviz']),
        ('share/' + package_name + '/foxglove', ['foxglove/robot.json']),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},  # colcon test looks for it
    zip_safe=True,
    maintainer='The FlexBT developers',
    maintainer_email='maintainers@flexbt.invalid',
    description='A lightweight 2D robot simulator with the standard interfaces of simulators.',
    license='BSD-3-Clause',
    entry_points={
        'console_scripts': [
            'simulator = flexbt_sim.executables:simulator',
            'world_tool = flexbt_sim.executables:world_tool',
        ],
    },
)
