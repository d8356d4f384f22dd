# SPDX-License-Identifier: BSD-3-Clause
from setuptools import find_packages, setup

package_name = 'flexbt_studio'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test', 'test.*']),
    package_data={package_name: ['py.typed', 'page/*']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
    ],
    install_requires=['setuptools', 'aiohttp', 'msgpack', 'pyyaml', 'pygls', 'pyzmq'],
    extras_require={'test': ['pytest', 'hypothesis']},  # colcon test looks for it
    zip_safe=False,  # the page is served from its files
    maintainer='The FlexBT developers',
    maintainer_email='maintainers@flexbt.invalid',
    description='The studio: write, check, run and watch missions in a browser; a language server for other editors.',
    license='BSD-3-Clause',
    entry_points={
        'flexbt.studio': ['studio = flexbt_studio.server.web_server:application'],
        'console_scripts': [
            'flexbt-ls = flexbt_studio.executables:language_server',
            'studio = flexbt_studio.executables:studio',
        ],
    },
)
