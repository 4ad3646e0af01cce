"""Prints the folder for PXR_PLUGINPATH_NAME."""

from . import folder

print(folder())
