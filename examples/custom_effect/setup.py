"""Install an effect that gravity_comp_ros does not know."""

from setuptools import setup

setup(
    name='custom_effect',
    version='0.1.0',
    description='An effect of our own for gravity_comp_ros',
    license='Apache-2.0',
    packages=['custom_effect'],
    install_requires=['gravity_comp_ros'],
    entry_points={
        'gravity_comp_ros.effects': ['seal_drag = custom_effect.seal:SealDrag'],
    },
)
