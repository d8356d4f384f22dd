# SPDX-License-Identifier: BSD-3-Clause
from pathlib import Path

from setuptools import find_packages, setup

package_name = 'flexbt_server'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test', 'test.*']),
    package_data={package_name: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
        ('share/' + package_name + '/behavior_trees', sorted(map(str, Path('behavior_trees').glob('*.xml')))),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},  # colcon test looks for it
    zip_safe=True,
    maintainer='The FlexBT developers',
    maintainer_email='maintainers@flexbt.invalid',
    description='The FlexBT behavior-tree server and its leaves for ROS.',
    license='BSD-3-Clause',
    entry_points={
        'console_scripts': [
            'bt_server = flexbt_server.executables:bt_server',
        ],
    },
)
