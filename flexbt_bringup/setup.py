# SPDX-License-Identifier: BSD-3-Clause
from pathlib import Path

from setuptools import find_packages, setup

package_name = 'flexbt_bringup'
share = Path('share') / package_name
template = [(str(share / file.parent), [str(file)]) for file in sorted(Path('template').rglob('*.in'))]

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test', 'test.*']),
    package_data={package_name: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
        ('share/' + package_name + '/launch', sorted(map(str, Path('launch').glob('*.launch.py')))),
        ('share/' + package_name + '/config', sorted(map(str, Path('config').glob('*.yaml')))),
        *template,
    ],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},  # colcon test looks for it
    zip_safe=True,
    maintainer='The FlexBT developers',
    maintainer_email='maintainers@flexbt.invalid',
    description='Launch and parameter files for real robots, and the command flexbt: doctor, init, manifest.',
    license='BSD-3-Clause',
    entry_points={'console_scripts': ['flexbt = flexbt_bringup.executables:flexbt']},
)
