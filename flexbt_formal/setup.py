# SPDX-License-Identifier: BSD-3-Clause
from setuptools import find_packages, setup

package_name = 'flexbt_formal'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test', 'test.*']),
    package_data={package_name: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
    ],
    install_requires=['setuptools', 'lark-parser', 'pyyaml'],
    extras_require={
        'synthesis': ['dd>=0.6'],  # CUDD is in its wheels, else it is pure Python
        'test': ['pytest', 'hypothesis'],  # colcon test looks for it
    },
    zip_safe=True,
    maintainer='The FlexBT developers',
    maintainer_email='maintainers@flexbt.invalid',
    description='What an engineer runs at a desk: planning, synthesis, proofs of trees and behaviors, models of AS2FM.',
    license='BSD-3-Clause',
    entry_points={
        'flexbt.bt_nodes': ['flexbt_formal = flexbt_formal.requests.reach_goal:register'],
        'flexbt.commands': [
            'behavior_tool.prove = flexbt_formal.cli.prove_behavior',
            'behavior_tool.synthesize = flexbt_formal.cli.synthesize',
            'bt_tool.plan = flexbt_formal.cli.plan',
            'bt_tool.prove = flexbt_formal.cli.prove_tree',
        ],
        'flexbt.synthesis': ['search = flexbt_formal.requests.search:main'],
        'flexbt.tree_checks': ['missions = flexbt_formal.requests.missions:missions'],
    },
)
