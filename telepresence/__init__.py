"""The version of the project, its only source: pyproject.toml reads it from this file.

The folder is also the package that a wheel installs; __main__.py has the command.
"""

__version__ = "0.9.0"
