"""The renderers: how each algorithm draws. One line per algorithm in the table below."""

from terrain.renderers.base import Renderer
from terrain.renderers.geomorph import GeomorphRenderer
from terrain.renderers.multiresolution import MultiresolutionRenderer
from terrain.renderers.painter import PainterRenderer
from terrain.renderers.perturbation import PerturbationRenderer
from terrain.renderers.reference import ReferenceRenderer
from terrain.renderers.slicing import SlicingRenderer

# The digit keys 0 to 5 follow this order.
_TABLE: tuple[type[Renderer], ...] = (
    ReferenceRenderer,
    SlicingRenderer,
    PainterRenderer,
    PerturbationRenderer,
    MultiresolutionRenderer,
    GeomorphRenderer,
)
RENDERERS: dict[str, type[Renderer]] = {renderer.name: renderer for renderer in _TABLE}
