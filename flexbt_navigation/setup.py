# SPDX-License-Identifier: BSD-3-Clause
from setuptools import find_packages, setup

package_name = 'flexbt_navigation'

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
    description='Navigation servers with the interfaces of Nav2, for the simulated robot.',
    license='BSD-3-Clause',
    entry_points={
        'console_scripts': [
            'navigation = flexbt_navigation.executables:navigation',
            'simulation = flexbt_navigation.executables:simulation',
            'lifecycle_manager = flexbt_navigation.executables:lifecycle_manager',
        ],
        'flexbt.navigators': ['navigation = flexbt_navigation.navigator:Navigator'],
    },
)
