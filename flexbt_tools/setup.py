# SPDX-License-Identifier: BSD-3-Clause
from setuptools import find_packages, setup

package_name = 'flexbt_tools'

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
    extras_require={
        'mcp': ['mcp>=2.3,<3'],  # bt_tool mcp
        'test': ['pytest'],  # colcon test looks for it
    },
    zip_safe=True,
    maintainer='The FlexBT developers',
    maintainer_email='maintainers@flexbt.invalid',
    description='Trees and behaviors without a robot: check, show, draw, run with mocks.',
    license='BSD-3-Clause',
    entry_points={
        'console_scripts': [
            'behavior_tool = flexbt_tools.executables:behavior_tool',
            'bt_tool = flexbt_tools.executables:bt_tool',
            'security_policy = flexbt_tools.executables:security_policy',
        ],
    },
)
