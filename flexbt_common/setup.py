# SPDX-License-Identifier: BSD-3-Clause
from pathlib import Path

from setuptools import find_packages, setup

package_name = 'flexbt_common'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test', 'test.*']),
    package_data={package_name: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
        *(
            (f'share/{package_name}/{directory}', [str(file) for file in sorted(Path(directory).glob('*.xml'))])
            for directory in ('config', 'config/fastdds3')
        ),
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},  # colcon test looks for it
    zip_safe=True,
    maintainer='The FlexBT developers',
    maintainer_email='maintainers@flexbt.invalid',
    description='What every FlexBT node shares: typed values, action calls with deadlines, liveliness, start and stop.',
    license='BSD-3-Clause',
    entry_points={
        'console_scripts': [],
    },
)
