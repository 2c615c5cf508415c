"""Reliefscope's engine: height fields, five rendering algorithms, and the means to judge them.

Layers, each importing only those to its right::

    measure -> stage -> drape -> renderers -> {algorithms, textures -> gpu} -> {flight, scene} -> {pyramid, frame}
    -> {camera, heightfield}

No window library and no ImGui below this package; ``algorithms`` and everything to its right touch no OpenGL.
"""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("reliefscope")
except PackageNotFoundError:  # a source tree on sys.path, not installed
    __version__ = "0+unknown"
