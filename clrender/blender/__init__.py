"""The add-on for Blender, and the file from which Blender installs it.

The folder `addon` is what runs in Blender's own Python, where the rest of the package may be missing: it imports
nothing of clrender and calls the program.
"""

from clrender.blender.bundle import write_addon

__all__ = ["write_addon"]
