"""Shader programs: includes, variants by ``#define``, errors that name file and line, reload while running.

``#include "lib/frame.glsl"`` (relative to ``shaders/``) is flattened here, each file once, and a line table turns the
driver's line numbers back into file and line: what GLSL compilers say about ``#line`` differs too much to rely on.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import moderngl

SHADERS = Path(__file__).resolve().parents[2] / "shaders"
FRAME_BINDING, TREES_BINDING = 0, 1
_BINDINGS = {"Frame": FRAME_BINDING, "Trees": TREES_BINDING}  # of uniform blocks, by name

# Texture units by sampler name, the same in all programs: what the stage binds, then what renderers bind themselves.
UNITS = {
    name: unit
    for unit, name in enumerate(
        ("u_heights", "u_ground", "u_light", "u_palette", "u_source", "u_previous", "u_packed", "u_pyramid", "u_layers",
         "u_extra0", "u_extra1", "u_extra2", "u_extra3", "u_coarse", "u_visibility", "u_morph",
         "u_pages", "u_atlas")
    )
}  # fmt: skip

_INCLUDE = re.compile(r'^\s*#\s*include\s+["<]([^">]+)[">]')
_LOCATION = re.compile(
    r"^(?:ERROR: )?\d+(?::|\()(\d+)"
)  # Mesa "0:4(19)", NVIDIA "0(4)", AMD, Intel, Apple "ERROR: 0:4:"


class ShaderError(RuntimeError):
    """A shader that cannot be read, compiled or linked; the message names file and line."""


@dataclass
class _Variant:
    """One compiled program and what it was made from, so that a change on disk can be seen."""

    program: moderngl.Program
    files: tuple[str, ...]
    stamp: tuple[int, ...]
    error: str = ""  # why what is on disk now is not what draws


class Programs:
    """The programs of one context, compiled at first use.

    Parameters
    ----------
    ctx : moderngl.Context
    defines : mapping
        Compile-time switches of every program.
    root : Path
        The folder of the shaders.
    """

    def __init__(self, ctx: moderngl.Context, defines: Mapping[str, Any], root: Path = SHADERS) -> None:
        self.ctx, self.defines, self.root = ctx, dict(defines), root
        self.shading_defines: dict[str, Any] = {}  # what the stage's look switches on; only for OUTPUT_SHADED
        self.generation = 0  # grows with every reload: whoever keeps a vertex array compares it
        self._variants: dict[tuple[Any, ...], _Variant] = {}

    def get(self, vertex: str, fragment: str, defines: Mapping[str, Any]) -> moderngl.Program:
        """The program of ``<vertex>.vert`` and ``<fragment>.frag`` under ``defines``.

        Raises
        ------
        ShaderError
        """
        used = {**self.defines, **defines}
        if "OUTPUT_SHADED" in used:
            used |= self.shading_defines
        key = (vertex, fragment, tuple(sorted(used.items())))
        if key not in self._variants:
            self._variants[key] = self._compile(vertex, fragment, used)
        return self._variants[key].program

    def reload_changed(self) -> list[str]:
        """Recompile programs whose files changed on disk; a broken one keeps its old program.

        Returns
        -------
        list of str
            One message for each program that could not be compiled.
        """
        errors = []
        for key, variant in list(self._variants.items()):
            stamp = self._stamp(variant.files)
            if stamp == variant.stamp:
                continue
            variant.stamp = stamp
            try:
                self._variants[key] = self._compile(key[0], key[1], dict(key[2]))
                _keep_uniforms(variant.program, self._variants[key].program)
                self.generation += 1
            except (ShaderError, OSError) as error:
                variant.error = str(error)
                errors.append(variant.error)
        return errors

    @property
    def errors(self) -> list[str]:
        """Why programs could not be reloaded, each message once; empty again when all is mended."""
        return list(dict.fromkeys(variant.error for variant in self._variants.values() if variant.error))

    def release(self) -> None:
        for variant in self._variants.values():
            variant.program.release()
        self._variants.clear()

    def _compile(self, vertex: str, fragment: str, defines: Mapping[str, Any]) -> _Variant:
        vertex_text, vertex_lines, vertex_files = flatten(self.root, f"{vertex}.vert", defines)
        fragment_text, fragment_lines, fragment_files = flatten(self.root, f"{fragment}.frag", defines)
        try:
            program = self.ctx.program(vertex_shader=vertex_text, fragment_shader=fragment_text)
        except moderngl.Error as error:
            in_fragment = "\nfragment_shader\n" in str(error)
            raise ShaderError(explain(str(error), fragment_lines if in_fragment else vertex_lines)) from None
        for name in program:
            member = program[name]
            if isinstance(member, moderngl.UniformBlock):
                member.binding = _BINDINGS[name]
            elif name in UNITS and isinstance(member, moderngl.Uniform):
                member.value = UNITS[name]
        files = tuple(sorted({*vertex_files, *fragment_files}))
        return _Variant(program, files, self._stamp(files))

    def _stamp(self, files: tuple[str, ...]) -> tuple[int, ...]:
        return tuple((self.root / f).stat().st_mtime_ns if (self.root / f).exists() else 0 for f in files)


def _keep_uniforms(old: moderngl.Program, new: moderngl.Program) -> None:
    """Give a reloaded program what was set on the one before, where both have it."""
    for name in new:
        member, before = new[name], old.get(name, None)
        if name in UNITS or not isinstance(member, moderngl.Uniform) or not isinstance(before, moderngl.Uniform):
            continue
        if (member.dimension, member.array_length) == (before.dimension, before.array_length):
            member.value = before.value


def flatten(
    root: Path, name: str, defines: Mapping[str, Any]
) -> tuple[str, list[tuple[str, int]], list[str]]:  # fmt: skip
    """The text of a shader with its includes, the (file, line) of each of its lines, and the files it is made of.

    Raises
    ------
    ShaderError
        If a file is missing, includes itself, or does not start with ``#version``.
    """
    lines: list[str] = []
    where: list[tuple[str, int]] = []
    seen: list[str] = []

    def read(relative: str, stack: tuple[str, ...]) -> None:
        if relative in stack:
            raise ShaderError("circular include: " + " -> ".join((*stack, relative)))
        if relative in seen:
            return
        seen.append(relative)
        try:
            text = (root / relative).read_text(encoding="utf-8")
        except OSError as error:
            raise ShaderError(f"{' -> '.join((*stack, relative))}: cannot be read ({error.strerror})") from None
        for number, line in enumerate(text.splitlines(), 1):
            if match := _INCLUDE.match(line):
                read(match[1], (*stack, relative))
                continue
            if not lines and not line.startswith("#version"):
                raise ShaderError(f"{relative}:1: the first line of a stage must be #version")
            lines.append(line)
            where.append((relative, number))
            if len(lines) == 1:
                lines.extend(f"#define {key} {value}" for key, value in defines.items())
                where.extend(("<defines>", 0) for _ in defines)

    read(name, ())
    return "\n".join(lines) + "\n", where, seen


def explain(message: str, where: list[tuple[str, int]]) -> str:
    """A driver's message with its line numbers turned into file and line."""

    def mend(line: str) -> str:
        match = _LOCATION.match(line)
        if not match or not 0 < int(match[1]) <= len(where):
            return line
        file, number = where[int(match[1]) - 1]
        return f"{file}:{number}{line[match.end() :]}"

    return "\n".join(mend(line) for line in message.splitlines())
