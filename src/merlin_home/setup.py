from catkin_pkg.python_setup import generate_distutils_setup
from setuptools import setup

setup(
    **generate_distutils_setup(
        packages=["merlin_home", "merlin_home.actions", "merlin_home.experiment"], package_dir={"": "src"}
    )
)
