"""No widget without an explanation, and none that no test operates: every window is drawn, and its calls are heard."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import pytest
from imgui_bundle import imgui
from ui_harness import UiHarness

from app.session.export import Order
from app.session.navigation import MODES
from app.session.preferences import Preferences
from app.windows.table import WINDOWS
from terrain.renderers import RENDERERS

WIDGETS = (
    "button", "small_button", "arrow_button", "invisible_button", "checkbox", "radio_button", "combo", "selectable",
    "slider_int", "slider_float", "drag_int", "drag_float", "input_int", "input_float", "input_double", "input_text",
    "input_text_with_hint", "color_edit3",
)  # fmt: skip
TELLS = ("set_item_tooltip", "set_tooltip", "is_item_hovered")  # what explains the widget drawn just before
TESTS = Path(__file__).parents[1]


class Heard:
    """The widgets drawn so far, and those among them that nothing explained."""

    def __init__(self, monkeypatch):
        self.labels: set[str] = set()
        self.unexplained: set[str] = set()
        self._last: str | None = None
        for name in WIDGETS:
            monkeypatch.setattr(imgui, name, self._widget(getattr(imgui, name)))
        for name in TELLS:
            monkeypatch.setattr(imgui, name, self._tell(getattr(imgui, name)))
        self._open = imgui.collapsing_header
        monkeypatch.setattr(imgui, "collapsing_header", lambda *arguments: bool(self._open(*arguments)) or True)

    def _widget(self, draw):
        def heard(label, *arguments, **named):
            self.end()
            self._last = str(label)
            self.labels.add(self._last)
            return draw(label, *arguments, **named)

        return heard

    def _tell(self, tell):
        def heard(*arguments, **named):
            self._last = None
            return tell(*arguments, **named)

        return heard

    def end(self):
        """The next widget comes, or the frame is over: what is explained is explained."""
        if self._last is not None:
            self.unexplained.add(self._last)
        self._last = None


@pytest.fixture
def heard(session, monkeypatch):
    """All windows with all their sections, for every algorithm."""
    for window in WINDOWS:
        session.layout.show(window.name)
    session.jobs.begin("Reading", "Escape cancels", lambda: None)
    with UiHarness(session) as harness:
        heard = Heard(monkeypatch)
        for window in WINDOWS:  # windows in one place show one tab at a time
            imgui.internal.clear_active_id()
            for name in RENDERERS:
                session.algorithms.choose(name)
                harness.frame(draw=lambda session: None)
                heard.end()
            found = imgui.internal.find_window_by_name(window.title)
            imgui.internal.focus_window(found)
            for _ in range(3):
                harness.frame(draw=lambda session: None)
                heard.end()
        yield heard


def test_every_widget_explains_itself_in_a_tooltip(heard):
    assert len(heard.labels) > 40
    assert heard.unexplained == set()


def test_every_widget_is_operated_by_a_test(heard, session):
    """Widgets of settings are, by tests that go through the settings; all others are named in a test."""
    kinds = [*(kind.Settings for kind in RENDERERS.values()), type(session.stage.look), Preferences, Order]
    fields = [field for kind in kinds for field in dataclasses.fields(kind) if "label" in field.metadata]
    assert all(re.fullmatch(r"[^.!?]+(\.\w[^.!?]*)*\.", field.metadata["help"]) for field in fields), "one sentence"
    settings = {f"##{field.metadata['label']}" for field in fields}
    tests = "\n".join(path.read_text(encoding="utf-8") for path in TESTS.rglob("test_*.py"))
    in_loops = {*(f"{name.capitalize()}##{name}" for name in RENDERERS), *(mode.capitalize() for mode in MODES)}
    others = {label for label in heard.labels if label not in settings | in_loops}
    names = {label[label.find("##") :] if "##" in label else label for label in others}
    untested = sorted(name for name in names if f'{name}"' not in tests and f"{name}/" not in tests)
    assert not untested, f"no test operates {', '.join(untested)}"
