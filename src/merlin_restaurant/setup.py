from catkin_pkg.python_setup import generate_distutils_setup
from setuptools import setup

setup(
    **generate_distutils_setup(
        packages=["merlin_restaurant", "merlin_restaurant.actions", "merlin_restaurant.players"],
        package_dir={"": "src"},
    )
)
