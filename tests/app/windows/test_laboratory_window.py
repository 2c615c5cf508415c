"""Every widget of the laboratory does what it says, driven by Dear ImGui's test engine."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from imgui_bundle import imgui, implot
from ui_harness import UiHarness

from app.session.laboratory import TOLERANCES_PX, run_point
from app.windows.laboratory import waste_figures
from terrain.measure.strip import StripFrame
from terrain.measure.waste import Waste
from terrain.renderers import RENDERERS

LABORATORY = "//Laboratory"


@pytest.fixture
def ui(session):
    session.layout.show("laboratory")
    with UiHarness(session) as harness:
        yield harness


def wait(ui, ctx, frames=400):
    """Until the task is done."""
    for _ in range(frames):
        if not ui.session.laboratory.is_busy:
            return
        ctx.yield_()
    raise AssertionError(f"{ui.session.laboratory.doing} never ends")


def measured(algorithm, tolerance, ms, px):
    return {
        "algorithm": algorithm, "settings": {"tolerance_px": tolerance},
        "frame_ms": {"p50": ms}, "geometric_error_px": {"p999": px},
    }  # fmt: skip


def with_runs(session):
    runs = [measured("geomorph", 1.0, 20.0, 0.8), measured("multiresolution", 4.0, 5.0, 3.0)]
    session.laboratory.results = {"runs": runs}
    return runs


def test_key_and_button_show_and_hide_the_laboratory(ui):
    def steps(ctx):
        ctx.mouse_move_to_pos((600.0, 500.0))
        ctx.key_press(imgui.Key.l)
        ctx.yield_(2)
        assert not ui.session.layout.is_open("laboratory")
        ctx.item_click("//Reliefscope/Lab")
        assert ui.session.layout.is_open("laboratory")

    ui.run(steps)


def test_the_gauge_shows_what_the_picture_delivers(ui):
    found = ui.session.laboratory.delivered
    assert found is not None
    assert (found.algorithm, found.tolerance_px) == (ui.session.algorithm, 1.0)
    assert 0.0 < found.p999_px <= found.max_px
    assert found.is_kept
    assert len(ui.session.laboratory.trail) == 1


def test_measuring_stops_while_nothing_changes_and_goes_on_when_something_does(ui, monkeypatch):
    lab, session = ui.session.laboratory, ui.session
    monkeypatch.setattr("app.session.laboratory.LIVE_PAUSE_S", 0.0)
    monkeypatch.setattr("app.session.laboratory.LIVE_SHARE", math.inf)
    lab._pause_until_s = 0.0
    for _ in range(5):
        ui.frame()
    assert len(lab.trail) == 1
    assert not lab.wants_work
    session.algorithms.choose("reference")
    assert lab.wants_work
    for _ in range(2):
        ui.frame()
    assert len(lab.trail) == 2
    assert lab.delivered.p999_px < 0.05
    session.layout.toggle("laboratory")
    session.algorithms.choose("geomorph")
    ui.frame()
    assert len(lab.trail) == 2


def test_measure_sweeps_in_slices_and_the_points_are_saved(ui, tmp_path):
    session, lab = ui.session, ui.session.laboratory

    def steps(ctx):
        ctx.set_ref(LABORATORY)
        for name in lab.chosen:
            if name != "geomorph":
                ctx.item_uncheck(f"{name.capitalize()}##{name}")
        ctx.item_input_value("##Frames", 4)
        assert lab.frames == 4
        ctx.item_click("Measure")
        assert lab.is_busy
        before = imgui.get_frame_count()
        wait(ui, ctx)
        assert imgui.get_frame_count() - before > 2
        ctx.item_click("Save")

    ui.run(steps)
    found = {(run["algorithm"], run["settings"]["tolerance_px"]) for run in lab.runs}
    assert found == {("reference", 1.0), *(("geomorph", t) for t in TOLERANCES_PX)}
    (saved,) = tmp_path.glob("hills-results-1/results.json")
    assert len(json.loads(saved.read_text())["runs"]) == 6
    assert "results.json" in session.message


def test_cancel_keeps_what_is_done(ui, monkeypatch):
    lab = ui.session.laboratory
    for name in ("BUDGET_S", "STILL_BUDGET_S"):
        monkeypatch.setattr(f"app.session.laboratory.{name}", 0.0)

    def steps(ctx):
        ctx.set_ref(LABORATORY)
        for name in lab.chosen:
            lab.chosen[name] = name == "geomorph"
        lab.frames = 4
        ctx.item_click("Measure")
        for _ in range(400):
            if lab.share > 1.2 / len(TOLERANCES_PX):
                break
            ctx.yield_()
        ctx.item_click("Cancel")
        assert not lab.is_busy
        ctx.yield_()
        assert ctx.item_exists("Measure")

    ui.run(steps)
    tolerances = {run["settings"]["tolerance_px"] for run in lab.runs if run["algorithm"] == "geomorph"}
    assert TOLERANCES_PX[0] in tolerances
    assert len(tolerances) < len(TOLERANCES_PX)


def test_a_click_on_a_point_draws_with_it(ui):
    session = ui.session
    runs = with_runs(session)
    places = {}
    plot_to_pixels = implot.plot_to_pixels

    def remember(point):
        place = plot_to_pixels(point)
        places[point.x] = (place.x, place.y)
        return place

    def steps(ctx):
        ctx.mouse_move_to_pos((1080.0, 150.0))
        ctx.yield_(2)
        for run in reversed(runs):
            ctx.mouse_move_to_pos(places[run_point(run)[0]])
            ctx.mouse_click(0)
            ctx.yield_(2)
            assert session.algorithm == run["algorithm"]
            assert session.settings.tolerance_px == run["settings"]["tolerance_px"]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(implot, "plot_to_pixels", remember)
        ui.run(steps)


def test_equal_error_and_equal_time_tune_the_chosen_algorithms(ui):
    session, lab = ui.session, ui.session.laboratory
    for name in lab.chosen:
        lab.chosen[name] = name in ("geomorph", "multiresolution")

    def steps(ctx):
        ctx.set_ref(LABORATORY)
        ctx.item_input_value("##Wanted error", 0.5)
        assert lab.wanted_px == pytest.approx(0.5)
        ctx.item_click("Equal error")
        wait(ui, ctx)
        assert set(session.algorithms.tuned) == {"geomorph", "multiresolution"}
        assert session.settings == session.algorithms.tuned["geomorph"]
        ctx.set_ref("//Reliefscope")
        ctx.combo_click(f"##Algorithm/{RENDERERS['multiresolution'].title}")
        assert session.settings == session.algorithms.tuned["multiresolution"]
        ctx.item_input_value("##Tolerance", 3.0)
        assert session.algorithms.tuned == {}
        ctx.set_ref(LABORATORY)
        ctx.item_input_value("##Wanted time", 10.0)
        assert lab.wanted_ms == pytest.approx(10.0)
        ctx.item_click("Equal time")
        wait(ui, ctx)
        assert set(session.algorithms.tuned) == {"geomorph", "multiresolution"}
        assert "ms each" in session.message

    ui.run(steps)


def test_best_for_me_chooses_among_what_was_measured(ui):
    session, lab = ui.session, ui.session.laboratory

    def steps(ctx):
        ctx.set_ref(LABORATORY)
        ctx.item_click("Best for me##error")
        assert "press Measure" in session.message
        with_runs(session)
        ctx.item_input_value("##Wanted time", 6.0)
        ctx.item_click("Best for me##time")
        assert (session.algorithm, session.settings.tolerance_px) == ("multiresolution", 4.0)
        ctx.item_input_value("##Wanted error", 1.0)
        ctx.item_click("Best for me##error")
        assert (session.algorithm, session.settings.tolerance_px) == ("geomorph", 1.0)
        ctx.item_input_value("##Wanted error", 0.3)
        ctx.item_click("Best for me##error")
        assert "No run" in session.message

    ui.run(steps)
    assert lab.wanted_px == pytest.approx(0.3)


def test_the_waste_of_a_view_is_metered(ui):
    def steps(ctx):
        ctx.set_ref(LABORATORY)
        ctx.item_open("Waste")
        ctx.item_click("Meter this view")
        wait(ui, ctx)

    ui.run(steps)
    waste = ui.session.laboratory.waste
    assert waste.triangles == ui.session.stats.triangles
    assert 0 < waste.needed < waste.triangles
    assert dict(waste_figures(ui.session))["triangles drawn"] == f"{waste.triangles:,}"


def test_waste_that_was_not_measured_is_left_out(session):
    assert waste_figures(session) == []
    session.laboratory.waste = Waste(10, 100, None, 1.0, 1.0, None, None, 1.0, 5)
    shown = dict(waste_figures(session))
    assert shown["needed for its error"] == "about 5 (1 : 2.0)"
    assert "smaller than a pixel" not in shown
    assert "slices" not in shown


def test_the_strip_is_measured_and_a_click_goes_there(ui, monkeypatch):
    session, lab = ui.session, ui.session.laboratory
    monkeypatch.setattr("app.session.laboratory.STRIP_FRAMES", 6)

    def steps(ctx):
        ctx.set_ref(LABORATORY)
        ctx.item_click("Check the flight")
        wait(ui, ctx)
        ctx.item_click("##Strip")  # its middle
        assert session.flights.time_s == pytest.approx(session.flights.duration_s / 2, rel=0.02)
        assert session.camera == session.flights.camera_at(session.flights.time_s)
        ctx.item_input_value("##Timeline", 1.0)
        assert session.camera == session.flights.camera_at(1.0)

    ui.run(steps)
    assert [frame.holes_px for frame in lab.strip] == [0] * 6
    assert lab.strip[-1].time_s == session.flights.duration_s


def test_replay_goes_on_from_where_the_timeline_was_clicked(ui):
    session = ui.session
    session.flights.toggle_playing()
    session.flights.seek(2.0)
    ui.frame()
    assert 2.0 < session.flights.time_s < 2.5
    assert session.flights.time_s == session.flights.time_s


def test_a_strip_with_trouble_is_drawn(ui):
    ui.session.laboratory.strip = [StripFrame(0.0, 5, 9.0, 1.0), StripFrame(1.0, 0, 0.0, 90.0)]
    ui.frame()


def test_b_is_chosen_compared_kept_and_swapped(ui):
    session, other = ui.session, ui.session.comparison

    def steps(ctx):
        ctx.set_ref(LABORATORY)
        ctx.item_close("Flight")
        ctx.item_open("A beside B")
        ctx.combo_click("##A and B/side by side")
        assert other.mode == "split"
        for name, kind in reversed(RENDERERS.items()):
            ctx.combo_click(f"##B is/{kind.title}")
            assert other.algorithm == name
        ctx.item_input_value("##Tolerance B", 4.0)
        assert other.settings.tolerance_px == pytest.approx(4.0)
        ctx.item_click("Swap")
        assert (session.algorithm, other.algorithm) == ("reference", "geomorph")
        assert (session.settings.tolerance_px, other.settings.tolerance_px) == (4.0, 1.0)
        ctx.item_click("Keep A as B")
        assert (other.algorithm, other.settings) == ("reference", session.settings)
        ctx.combo_click("##A and B/difference")
        assert other.mode == "difference"
        ctx.combo_click("##A and B/off")
        assert other.mode == "off"

    ui.run(steps)


def test_the_divider_is_dragged_and_the_scene_stays(ui):
    session, other = ui.session, ui.session.comparison
    session.compare("split")
    camera = session.camera

    def steps(ctx):
        ctx.mouse_move_to_pos((640.0, 300.0))
        ctx.yield_(2)
        ctx.mouse_down(0)
        ctx.mouse_move_to_pos((500.0, 330.0))
        ctx.mouse_up(0)
        ctx.yield_(2)
        assert other.divider == pytest.approx(500.0 / 1280.0, abs=0.01)

    ui.run(steps)
    assert session.camera == camera


def test_a_split_picture_is_half_a_and_half_b(session):
    session.choose_view("levels")
    session.draw((64, 36))
    alone = session.comparison.compose(session.picture)
    session.choose_other("reference")
    session.compare("split")
    session.draw((64, 36))
    split = session.comparison.compose(session.picture)
    a, b = session.comparison.parts(session.picture)
    assert (a.left, a.right, b.left, b.right) == (0.0, 0.5, 0.5, 1.0)
    assert np.array_equal(split[:, :32], alone[:, :32])
    assert np.array_equal(split[:, 32:], b.target.read()[:, 32:, :3])
    assert not np.array_equal(split, alone)


def test_the_difference_of_a_picture_with_itself_is_black(session):
    session.choose_other(session.algorithm, session.settings)
    session.compare("difference")
    session.draw((64, 36))
    assert session.comparison.compose(session.picture).max() == 0
    session.choose_view("levels")
    session.choose_other("reference")
    session.draw((64, 36))
    assert session.comparison.compose(session.picture).max() > 30


def test_frozen_selections_are_compared_too(session):
    def picture_of_b():
        session.choose_other("reference")
        session.choose_other("multiresolution")
        session.draw((64, 36))
        return session.comparison.parts(session.picture)[1].target.read()[..., :3].astype(int)

    session.compare("split")
    free = picture_of_b()
    session.toggle_freeze()
    frozen = picture_of_b()
    changed = np.abs(frozen - free).max(axis=-1) > 20  # the frozen frustum runs along the picture's edge
    assert changed.mean() < 0.3


def test_a_task_that_fails_is_told_and_ends(ui, monkeypatch):
    def fail(*args):
        raise ValueError("too large")

    monkeypatch.setattr("app.session.laboratory.measure_waste", fail)
    ui.session.laboratory.meter_waste()
    ui.frame()
    assert not ui.session.laboratory.is_busy
    assert "too large" in ui.session.message


def test_exaggeration_forgets_what_was_measured(ui):
    with_runs(ui.session)
    ui.session.compare("split")
    ui.frame()
    ui.session.exaggerate(2.0)
    assert ui.session.laboratory.runs == []
    ui.frame()


def test_no_widget_of_the_laboratory_leaves_its_panel(ui):
    def steps(ctx):
        ctx.set_ref(LABORATORY)
        for title in ("A beside B", "Waste"):
            ctx.item_open(title)
        ctx.yield_(2)
        window = ctx.window_info(LABORATORY).window
        for item in ("Equal error", "Best for me##error", "Best for me##time", "Keep A as B", "Swap", "##Strip"):
            rect = ctx.item_info(item).rect_full
            assert window.pos.x <= rect.min.x
            assert rect.max.x <= window.pos.x + window.size.x, item

    ui.run(steps)
