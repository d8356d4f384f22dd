# SPDX-License-Identifier: BSD-3-Clause
from pathlib import Path

from setuptools import find_packages, setup

package_name = 'flexbt_core'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test', 'test.*']),
    package_data={package_name: ['py.typed', '__init__.pyi']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
    ],
    python_requires='>=3.11',
    install_requires=['pyyaml'],
    extras_require={
        'test': ['pytest', 'hypothesis'],  # colcon test looks for it
    },
    zip_safe=True,
    maintainer='The FlexBT developers',
    maintainer_email='maintainers@flexbt.invalid',
    description='Behavior trees (BehaviorTree.CPP) and state machines (FlexBE), with skills and monitors, without ROS.',
    # colcon runs this through a symbolic link.
    long_description=(Path(__file__).resolve().parent / 'README.md').read_text(encoding='utf-8'),
    long_description_content_type='text/markdown',
    classifiers=[
        'Development Status :: 4 - Beta',
        'Intended Audience :: Developers',
        'Intended Audience :: Science/Research',
        'Operating System :: POSIX',
        'Programming Language :: Python :: 3 :: Only',
        'Programming Language :: Python :: 3.11',
        'Programming Language :: Python :: 3.12',
        'Topic :: Scientific/Engineering :: Artificial Intelligence',
        'Typing :: Typed',
    ],
    license='BSD-3-Clause',
)
