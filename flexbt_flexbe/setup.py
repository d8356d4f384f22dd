# SPDX-License-Identifier: BSD-3-Clause
from setuptools import find_packages, setup

package_name = 'flexbt_flexbe'

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
    zip_safe=False,
    maintainer='The FlexBT developers',
    maintainer_email='maintainers@flexbt.invalid',
    description="FlexBE's states and behaviors under FlexBT: its Python interface, generic states and manifests.",
    license='BSD-3-Clause',
    entry_points={
        'console_scripts': [],
        'flexbt.behavior_hosts': ['flexbe = flexbt_flexbe.discovery:host'],
        'flexbt.behavior_sources': ['flexbe = flexbt_flexbe.discovery:entries'],
    },
)
