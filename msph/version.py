"""Version of the program; `msph.__version__` without importing the rest of the package."""

VERSION = "0.1.0"
