"""Installation of a custom effect for gravity_comp_ros."""

from setuptools import setup

setup(
    name='custom_effect',
    version='0.1.0',
    description='A custom effect for gravity_comp_ros',
    license='Apache-2.0',
    packages=['custom_effect'],
    install_requires=['gravity_comp_ros'],
    entry_points={
        'gravity_comp_ros.effects': ['seal_drag = custom_effect.seal:SealDrag'],
    },
)
