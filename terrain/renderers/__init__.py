"""The renderers: how each algorithm draws. One line per algorithm in the table below."""

from terrain.renderers.base import Renderer
from terrain.renderers.reference import ReferenceRenderer

RENDERERS: dict[str, type[Renderer]] = {renderer.name: renderer for renderer in (ReferenceRenderer,)}
