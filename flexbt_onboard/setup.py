# SPDX-License-Identifier: BSD-3-Clause
from setuptools import find_packages, setup

package_name = 'flexbt_onboard'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test', 'test.*']),
    package_data={package_name: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},  # colcon test looks for it
    zip_safe=True,
    maintainer='The FlexBT developers',
    maintainer_email='maintainers@flexbt.invalid',
    description='The FlexBT onboard executive: runs supervised behaviors on the robot.',
    license='BSD-3-Clause',
    entry_points={
        'console_scripts': [
            'onboard_executive = flexbt_onboard.executables:onboard_executive',
            'stop_guard = flexbt_onboard.executables:stop_guard',
            'run_report = flexbt_onboard.executables:run_report',
        ],
    },
)
