"""The version's only home; the package's metadata are built from it."""

__version__ = "0.1.0"
