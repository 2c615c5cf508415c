"""Every widget and key of the timeline, the export, the open window and the questions does what it says."""

from __future__ import annotations

import dataclasses

import pytest
from imgui_bundle import imgui
from ui_harness import UiHarness

from app.flying.flight_lines import way_segments
from app.session.export import Order
from app.viewer import gui
from app.viewer.keys import bindings
from terrain.camera import Camera
from terrain.flight import PACES, Flight, Keyframe

TIMELINE, EXPORT, OPEN = "//Timeline", "//Export", "//Open"
CLEAR = (800.0, 200.0)


@pytest.fixture
def ui(session):
    keys = [Keyframe(2.0 * i, Camera((40.0 + 60.0 * i, 60.0, 250.0 - 40.0 * i), 20.0 * i)) for i in range(4)]
    session.flights.show(Flight(tuple(keys), "short", "hills"))
    session.flights.discard()
    with UiHarness(session) as harness:
        yield harness


def shown_in(ui, name, steps):
    """Run steps with a window open."""
    ui.session.layout.show(name)
    ui.frame()
    ui.frame()
    ui.run(steps)


def test_every_button_of_playing_does_what_it_says(ui):
    flights = ui.session.flights

    def steps(ctx):
        ctx.set_ref(TIMELINE)
        ctx.item_click(">|##last")
        assert flights.time_s == 6.0
        ctx.item_click("|<##first")
        assert flights.time_s == 0.0
        ctx.item_click(">##forward")
        ctx.item_click(">##forward")
        ctx.item_click("<##back")
        assert flights.time_s == pytest.approx(1 / 30)
        ctx.item_click("Play##play")
        ctx.yield_(3)
        assert flights.is_playing
        ctx.item_click("Pause##play")
        assert not flights.is_playing
        ctx.item_click("Loop")
        assert flights.loops
        for pace in PACES:
            ctx.combo_click(f"##Pace/{pace}")
            assert flights.pace == pace
        ctx.item_input_value("##Fps", 60)
        assert flights.fps == 60

    shown_in(ui, "timeline", steps)


def lane_x(ctx, ui, time_s):
    rect = ctx.item_info(f"{TIMELINE}/##Lane").rect_full
    em = imgui.get_font_size()
    share = time_s / ui.session.flights.duration_s
    return rect.min.x + em + share * (rect.max.x - rect.min.x - 2 * em), (rect.min.y + rect.max.y) / 2 + em / 2


def test_a_click_on_the_lane_goes_there_and_a_drag_scrubs(ui):
    flights = ui.session.flights

    def steps(ctx):
        ctx.mouse_move_to_pos(lane_x(ctx, ui, 3.1))
        ctx.mouse_click(0)
        assert flights.time_s == pytest.approx(3.1, abs=0.03)
        assert ui.session.camera == flights.camera_at(flights.time_s)
        ctx.mouse_down(0)
        for time_s in (3.5, 4.4, 5.0):
            ctx.mouse_move_to_pos(lane_x(ctx, ui, time_s))
            assert flights.time_s == pytest.approx(time_s, abs=0.03)
        ctx.mouse_up(0)
        assert not flights.timeline.is_changed

    shown_in(ui, "timeline", steps)


def test_a_keyframe_is_selected_by_a_click_and_moved_by_a_drag(ui):
    flights = ui.session.flights

    def steps(ctx):
        ctx.mouse_move_to_pos(lane_x(ctx, ui, 2.0))
        ctx.mouse_click(0)
        assert flights.timeline.selected == 1
        assert flights.time_s == 2.0
        assert not flights.timeline.is_changed
        start = flights.flight
        ctx.mouse_down(0)
        for time_s in (2.4, 3.0, 3.4):
            ctx.mouse_move_to_pos(lane_x(ctx, ui, time_s))
        ctx.mouse_up(0)
        assert flights.timeline.times_s == pytest.approx([0.0, 3.4, 4.0, 6.0], abs=0.05)
        ctx.item_click(f"{TIMELINE}/Undo")
        assert flights.flight is start

    shown_in(ui, "timeline", steps)


def test_every_button_of_editing_does_what_it_says(ui, tmp_path):
    session, flights = ui.session, ui.session.flights
    first = flights.flight

    def steps(ctx):
        ctx.set_ref(TIMELINE)
        flights.seek(3.0)
        session.look_from(Camera((100.0, 90.0, 100.0), 77.0))
        ctx.item_click("Add")
        assert flights.timeline.times_s == [0.0, 2.0, 3.0, 4.0, 6.0]
        assert flights.camera_at(3.0).yaw_deg == pytest.approx(77.0)
        assert flights.timeline.selected == 2
        session.look_from(Camera((100.0, 90.0, 100.0), 11.0))
        ctx.item_click("Update")
        assert flights.camera_at(3.0).yaw_deg == pytest.approx(11.0)
        ctx.item_input_value("##Time", 5.0)
        assert flights.timeline.times_s == [0.0, 2.0, 4.0, 5.0, 6.0]
        ctx.item_input_value("##Duration", 12.0)
        assert flights.timeline.times_s == pytest.approx([0.0, 4.0, 8.0, 10.0, 12.0])
        ctx.item_click("Delete")
        assert flights.timeline.times_s == pytest.approx([0.0, 4.0, 8.0, 12.0])
        for _ in range(5):
            ctx.item_click("Undo")
        assert flights.flight is first
        ctx.item_click("Redo")
        assert len(flights.flight.keyframes) == 5
        ctx.item_click("Save*##save")
        assert not flights.timeline.is_changed
        assert len(list(tmp_path.glob("*.flight.json"))) == 1
        ctx.item_click("KML")
        assert "coordinate system" in session.message  # these hills lie nowhere on Earth
        ctx.item_click("New")
        assert len(flights.flight.keyframes) == 1
        ctx.item_click("Add")
        assert flights.duration_s == 3.0

    shown_in(ui, "timeline", steps)


def test_the_keys_of_the_flight_do_what_they_say(ui, tmp_path):
    session, flights = ui.session, ui.session.flights

    def steps(ctx):
        def press(key):
            name = key.removeprefix(gui.CTRL)
            ctx.key_press(gui.key_named(name) | (imgui.Key.mod_ctrl if name != key else 0))
            ctx.yield_(2)

        ctx.mouse_move_to_pos(CLEAR)
        press("K")
        assert session.layout.is_open("timeline")
        press("Period")
        press("Period")
        press("Comma")
        assert flights.time_s == pytest.approx(1 / 30)
        flights.select_keyframe(1)
        session.look_from(Camera((100.0, 90.0, 100.0), 77.0))
        press("U")
        assert flights.flight.keyframes[1].camera.yaw_deg == 77.0
        press("Delete")
        assert len(flights.flight.keyframes) == 3
        press("Ctrl+Z")
        assert len(flights.flight.keyframes) == 4
        press("Ctrl+Y")
        assert len(flights.flight.keyframes) == 3
        flights.seek(1.0)
        press("Insert")
        assert len(flights.flight.keyframes) == 4
        press("Ctrl+S")
        assert len(list(tmp_path.glob("*.flight.json"))) == 1
        for key, window in (("K", "timeline"), ("Ctrl+E", "export"), ("Ctrl+O", "open")):
            before = session.layout.is_open(window)
            press(key)
            assert session.layout.is_open(window) != before

    ui.run(steps)


def test_keys_without_a_selected_keyframe_say_what_to_do(ui):
    flights = ui.session.flights
    for act in (flights.update_keyframe, flights.delete_keyframe):
        flights.timeline.selected = None
        act()
        assert "Select a keyframe" in ui.session.message
    flights.start_anew()
    flights.delete_keyframe()
    assert "at least one" in ui.session.message


def test_the_menu_items_without_keys_do_what_they_say(ui):
    told = {binding.help: binding for binding in bindings() if not binding.key}
    told["read the terrain's file again"].act(ui.session)
    assert "no file" in ui.session.message
    told["save the flight as KML, for Google Earth"].act(ui.session)
    assert "coordinate system" in ui.session.message


def test_the_way_is_drawn_in_the_scene_while_the_timeline_is_open(ui):
    session = ui.session
    session.look_from(Camera((130.0, 160.0, 420.0), 0.0, -30.0))

    def picture():
        session.touch()
        return session.draw((96, 54)).read()[..., :3].astype(int)

    bare = picture()
    session.layout.show("timeline")
    lines = picture()
    session.flights.timeline.selected = 2
    selected = picture()
    session.layout.show("timeline", False)
    assert 20 < (abs(lines - bare).max(axis=-1) > 25).sum() < 2000
    assert (abs(selected - lines).max(axis=-1) > 25).sum() > 3
    assert (picture() == bare).all()


def test_the_way_has_no_line_across_a_cut():
    here, there = Camera((0.0, 0.0, 0.0)), Camera((1e4, 0.0, 0.0))
    keys = (Keyframe(0.0, here), Keyframe(1.0, here), Keyframe(1.0, there), Keyframe(2.0, there))
    segments = way_segments(Flight(keys))
    assert abs(segments[:, 1] - segments[:, 0]).max() < 1.0
    assert way_segments(Flight(keys[:1])).shape == (0, 2, 3)


def test_every_field_of_the_export_has_a_widget_that_changes_it(ui):
    exporter = ui.session.exporter

    def steps(ctx):
        ctx.set_ref(EXPORT)
        labels = {field.name: field.metadata["label"] for field in dataclasses.fields(Order)}
        for kind in ("frames", "picture", "film"):
            ctx.combo_click(f"##What/{kind}")
            assert exporter.order.kind == kind
            assert ctx.item_exists(f"##{labels['straight_down']}") == (kind == "picture")
            assert ctx.item_exists(f"##{labels['codec']}") == (kind == "film")
            assert ctx.item_exists(f"##{labels['fps']}") == (kind != "picture")
        for name, value in (("width_px", 96), ("height_px", 54), ("fps", 12), ("frames", 5)):
            ctx.item_input_value(f"##{labels[name]}", value)
            assert getattr(exporter.order, name) == value
        ctx.combo_click(f"##{labels['codec']}/av1")
        assert exporter.order.codec == "av1"
        ctx.combo_click("##What/picture")
        ctx.item_click(f"##{labels['straight_down']}")
        assert exporter.order.straight_down

    shown_in(ui, "export", steps)


def test_an_export_is_started_watched_and_cancelled(ui, tmp_path):
    exporter = ui.session.exporter
    exporter.order = Order(kind="frames", width_px=64, height_px=36, frames=5000)

    def steps(ctx):
        ctx.set_ref(EXPORT)
        ctx.item_click("Export")
        ctx.yield_(4)
        assert exporter.is_busy
        assert any(job.name.startswith("Exporting hills-frames-1") for job in ui.session.jobs)
        ctx.item_click("Cancel")
        assert not exporter.is_busy
        assert "holds what was done" in ui.session.message
        exporter.order = dataclasses.replace(exporter.order, frames=3)
        ctx.item_click("Export")
        while exporter.is_busy:
            ctx.yield_()
        assert "3 frames" in ui.session.message

    shown_in(ui, "export", steps)
    assert len(list((tmp_path / "hills-frames-2").iterdir())) == 3


def test_files_are_found_and_opened(ui, tmp_path, monkeypatch):
    session, asked = ui.session, []
    monkeypatch.setattr(session.loader, "open", lambda session, paths, as_terrain: asked.append((paths, as_terrain)))
    (tmp_path / "Alps").mkdir()
    (tmp_path / "Alps" / "dem.tif").write_text("x")
    (tmp_path / "notes.txt").write_text("x")
    session.preferences.remember_file(tmp_path / "notes.txt")

    def again(ctx):
        """What was chosen closes the window."""
        assert not session.layout.is_open("open")
        session.layout.show("open")
        ctx.yield_(3)
        ctx.set_ref(OPEN)

    def enter(ctx, text):
        ctx.item_input("##Path")
        ctx.key_chars_replace(text)
        ctx.key_press(imgui.Key.enter)
        ctx.yield_(2)

    def steps(ctx):
        files = ctx.window_info(f"{OPEN}/Files").window.id_
        ctx.set_ref(files)
        ctx.item_click("Alps/##Alps".replace("/", "\\/"))
        ctx.yield_(2)
        assert session.browser.folder == tmp_path / "Alps"
        ctx.set_ref(files)
        ctx.item_click("dem.tif  1 bytes##dem.tif")
        assert asked[-1] == ([tmp_path / "Alps" / "dem.tif"], False)
        again(ctx)
        ctx.item_click("Up")
        assert session.browser.folder == tmp_path
        ctx.item_click("Pictures as terrain")
        ctx.item_click("All files")
        assert session.browser.shows_all
        enter(ctx, str(tmp_path / "Alps" / "dem.tif"))
        assert asked[-1] == ([tmp_path / "Alps" / "dem.tif"], True)
        again(ctx)
        recent = str(tmp_path / "notes.txt")
        ctx.item_click(f"notes.txt##{recent}".replace("/", "\\/"))
        assert asked[-1] == ([tmp_path / "notes.txt"], True)
        again(ctx)
        enter(ctx, "nowhere.tif")
        assert "nowhere.tif" in session.browser.problem
        assert len(asked) == 3

    shown_in(ui, "open", steps)


@pytest.mark.parametrize("answer", ["Save", "Discard", "Stay", "Escape"])
def test_unsaved_changes_are_asked_about(ui, tmp_path, answer):
    session = ui.session
    session.flights.timeline.move(1, 2.5)

    def steps(ctx):
        ctx.mouse_move_to_pos(CLEAR)
        ctx.key_press(imgui.Key.mod_ctrl | imgui.Key.q)
        ctx.yield_(3)
        assert not session.is_leaving
        ctx.set_ref("//Unsaved changes")
        if answer == "Escape":
            ctx.key_press(imgui.Key.escape)
        else:
            ctx.item_click(answer)
        ctx.yield_(3)
        assert session.dialogs.question is None
        assert not imgui.is_popup_open("", imgui.PopupFlags_.any_popup)

    ui.run(steps)
    assert session.is_leaving == (answer in ("Save", "Discard"))
    assert len(list(tmp_path.glob("*.flight.json"))) == (answer == "Save")


def test_a_track_is_imported_as_chosen(ui, tmp_path):
    session = ui.session
    path = tmp_path / "a.csv"
    path.write_text("t,x,y,z\n0,50,40,50\n9,250,40,250\n")
    session.dialogs.import_track(path)

    def steps(ctx):
        ctx.yield_(2)
        ctx.set_ref("//Import a track")
        ctx.item_click("##Above the ground")
        ctx.item_input_value("##Height", 33.0)
        ctx.item_input_value("##Time", 12.0)
        ctx.item_click("Import")
        ctx.yield_(2)
        x, y, z = session.flights.camera_at(0.0).position_m
        assert (x, z) == (50.0, 50.0)
        assert y - session.heightfield.heights_at(x, z) == pytest.approx(33.0)
        assert session.flights.duration_s == pytest.approx(12.0)
        session.flights.discard()
        session.dialogs.import_track(path)
        ctx.yield_(2)
        ctx.item_click("##Choose the time")
        ctx.item_click("Import")
        ctx.yield_(2)
        assert session.flights.duration_s == pytest.approx(9.0)
        session.dialogs.import_track(path)
        ctx.yield_(2)
        ctx.item_click("Leave it")
        ctx.yield_(2)
        assert session.dialogs.track is None

    ui.run(steps)
