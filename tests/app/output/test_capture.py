"""Pictures arrive whole or not at all, and never on top of what exists."""

from __future__ import annotations

import av
import numpy as np
import pytest
from PIL import Image

from app.output.capture import Film, FrameFolder, open_sink, replacing, save_array, save_png
from terrain.errors import InputError

rng = np.random.default_rng(5)
PICTURE = rng.integers(0, 256, (36, 64, 3), np.uint8)


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_png_holds_the_picture_exactly(tmp_path):
    save_png(tmp_path / "a.png", PICTURE)
    with Image.open(tmp_path / "a.png") as image:
        assert np.array_equal(np.asarray(image), PICTURE)
    assert names(tmp_path) == ["a.png"]


def test_what_exists_is_replaced_only_when_asked(tmp_path):
    path = tmp_path / "a.png"
    path.write_text("mine")
    with pytest.raises(InputError, match="overwrite"):
        save_png(path, PICTURE)
    assert path.read_text() == "mine"
    save_png(path, PICTURE, overwrite=True)
    with Image.open(path) as image:
        assert image.size == (64, 36)


def test_a_failed_write_leaves_what_was_there(tmp_path):
    path = tmp_path / "a.npy"
    save_array(path, np.arange(3))

    def write_half():
        with replacing(path, overwrite=True) as temporary:
            temporary.write_text("half")
            raise RuntimeError("half way")

    with pytest.raises(RuntimeError, match="half way"):
        write_half()
    assert np.array_equal(np.load(path), np.arange(3))
    assert names(tmp_path) == ["a.npy"]


def test_missing_folder_and_folder_instead_of_file_are_refused(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        save_png(tmp_path / "no" / "a.png", PICTURE)
    with pytest.raises(InputError, match="folder"):
        save_png(tmp_path, PICTURE)


def test_frames_are_numbered_in_a_folder_of_their_own(tmp_path):
    with open_sink(tmp_path / "frames", (64, 36), 24) as sink:
        sink.add(PICTURE)
        sink.add(PICTURE)
    assert names(tmp_path / "frames") == ["frame_0000.png", "frame_0001.png"]
    with pytest.raises(InputError, match="holds frames already"):
        FrameFolder(tmp_path / "frames")


@pytest.mark.parametrize("size_px", [(64, 36), (63, 35)])
def test_film_holds_every_frame_at_its_rate(tmp_path, size_px):
    path = tmp_path / "a.mp4"
    with open_sink(path, size_px, 24) as sink:
        for shade in (0, 128, 255):
            sink.add(np.full((size_px[1], size_px[0], 3), shade, np.uint8))
    with av.open(str(path)) as film:
        stream = film.streams.video[0]
        shades = [frame.to_ndarray(format="rgb24").mean() for frame in film.decode(stream)]
        assert (stream.average_rate, stream.width, stream.height) == (24, size_px[0] // 2 * 2, size_px[1] // 2 * 2)
    assert shades == pytest.approx([0, 128, 255], abs=6)


def test_film_interrupted_by_the_user_keeps_its_frames_and_a_failed_one_leaves_nothing(tmp_path):
    def film_until(name, error):
        with Film(tmp_path / name, (64, 36), 24) as film:
            film.add(PICTURE)
            raise error

    with pytest.raises(KeyboardInterrupt):
        film_until("kept.mp4", KeyboardInterrupt())
    with pytest.raises(ValueError, match="broken"):
        film_until("lost.mp4", ValueError("broken"))
    assert names(tmp_path) == ["kept.mp4"]


def test_film_too_small_to_exist_is_refused(tmp_path):
    with pytest.raises(InputError, match="2 x 2"):
        Film(tmp_path / "a.mp4", (1, 36), 24)
