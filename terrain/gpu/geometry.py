"""Vertex arrays for every output variant of one pair of shaders."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import moderngl

from terrain.frame import Output
from terrain.gpu.context import Gpu


class Geometry:
    """Buffers drawn by ``<vertex>.vert`` and ``<fragment>.frag``; a vertex array is made for each variant at first use.

    Parameters
    ----------
    gpu : Gpu
    vertex, fragment : str
        Shader stems.
    content : sequence of (buffer, format, attribute ...)
        As in ``moderngl.Context.vertex_array``; attributes a variant does not use are left out.
    index_buffer : moderngl.Buffer or None
        32-bit indices.
    defines : mapping
        Compile-time switches beside those of the output.
    """

    def __init__(
        self, gpu: Gpu, vertex: str, fragment: str, content: Sequence[tuple[Any, ...]] = (),
        index_buffer: moderngl.Buffer | None = None, defines: Mapping[str, Any] | None = None,
    ) -> None:  # fmt: skip
        self._gpu, self._vertex, self._fragment = gpu, vertex, fragment
        self._content, self._index_buffer = list(content), index_buffer
        self._defines = dict(defines or {})
        self._arrays: dict[int, tuple[moderngl.Program, moderngl.VertexArray]] = {}
        self._generation = gpu.programs.generation

    def program(self, output: Output) -> moderngl.Program:
        """The program that draws ``output``: for uniforms of one renderer alone."""
        return self._gpu.program(self._vertex, self._fragment, output, self._defines)

    def render(
        self, output: Output, mode: int = moderngl.TRIANGLES, vertices: int = -1, *, first: int = 0, instances: int = -1
    ) -> None:
        """Draw; see ``moderngl.VertexArray.render``."""
        self.array(output).render(mode, vertices, first=first, instances=instances)

    def array(self, output: Output) -> moderngl.VertexArray:
        """The vertex array that draws ``output``: for many calls in a row, without looking it up for each."""
        if self._generation != self._gpu.programs.generation:  # shaders were reloaded
            self._release_arrays()
            self._generation = self._gpu.programs.generation
        program = self.program(output)
        if program.glo not in self._arrays:
            array = self._gpu.ctx.vertex_array(
                program, self._content, index_buffer=self._index_buffer, index_element_size=4, skip_errors=True
            )
            self._arrays[program.glo] = (program, array)
        return self._arrays[program.glo][1]

    def _release_arrays(self) -> None:
        for _, array in self._arrays.values():
            array.release()
        self._arrays.clear()

    def release(self) -> None:
        """Release the vertex arrays; buffers belong to who made them."""
        self._release_arrays()
