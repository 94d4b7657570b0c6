"""Constants of the whole program, in a module without imports: signals are handled only later."""

# Version of the package (also in pyproject.toml).
VERSION = "0.1.0"
# Scene of a command that is given no scene.
DEFAULT_SCENE = "pool"
