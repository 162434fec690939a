"""Motions as files: a page that plays without a server, and films."""

import io
from itertools import pairwise

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image

import jaxik
from jaxik.view.browser import ShownMotion, recording, save_recording
from tests.helpers import chromium

pytestmark = pytest.mark.slow
MODEL = jaxik.presets.iiwa14()
TIME = np.linspace(0.0, 1.0, 6)
Q = np.array([0.3, 0.5, 0.2, -1.2, 0.1, 0.9, 0.0]) + 0.6 * np.sin(3 * TIME[:, None] + np.arange(7))
WORLD = jaxik.World([[0.2, 0.4, 0.6]], 0.1, normals=[[0.0, 0.0, -1.0]], offsets=[0.0])


def shown(caption, q=Q, world=None):
    return ShownMotion(MODEL, jaxik.Trajectory(TIME, q, MODEL.joint_names, MODEL.name), caption, None, world)


def differing(a, b):
    """Share of pixels that differ."""
    return (np.abs(np.asarray(a, float) - np.asarray(b, float)).max(-1) > 40).mean()


def test_a_saved_page_plays_without_a_server_or_network(tmp_path):
    chromium.require()
    file = tmp_path / "two.html"
    save_recording([shown("first", world=WORLD), shown("second", Q[::-1])], file)
    assert [f.name for f in tmp_path.iterdir()] == ["two.html"]
    with chromium.visit(file.as_uri()) as visit:
        visit.page.wait_for_selector("canvas")
        assert visit.page.title() == "jaxik: first, second"
        pictures = []
        for _ in range(12):
            shot = Image.open(io.BytesIO(visit.page.screenshot())).convert("RGB")
            pictures.append(shot.crop((0, 100, 1000, 600)))
            visit.page.wait_for_timeout(200)
        assert max(differing(pictures[0], picture) for picture in pictures[1:]) > 0.003, "it does not move"
        assert not visit.errors
        assert not visit.strangers


# imageio-ffmpeg leaves a pipe to its program to the garbage collector.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_film_shows_the_motion(tmp_path):
    chromium.require()
    file = tmp_path / "motion.gif"
    done = []
    save_recording([shown("it")], file, size=(320, 240), rate=4.0, progress=done.append)
    assert done == [pytest.approx(k / 5) for k in range(1, 6)]
    with Image.open(file) as film:
        assert film.size == (320, 240)
        assert film.info["duration"] == 250
        frames = []
        for k in range(film.n_frames):
            film.seek(k)
            frames.append(film.convert("RGB"))
    assert len(frames) == 5
    for before, after in pairwise(frames):
        assert differing(before, after) > 0.003

    # The same pictures as MP4, whose compression blurs edges.
    film = tmp_path / "motion.mp4"
    film.write_bytes(recording._mp4(iter(frames), 4.0, (320, 240)))
    reader = imageio_ffmpeg.read_frames(str(film))
    facts = next(reader)
    assert (facts["codec"], facts["size"], facts["fps"]) == ("h264", (320, 240), 4.0)
    pictures = [np.frombuffer(frame, np.uint8).reshape(240, 320, 3) for frame in reader]
    assert len(pictures) == 5
    for picture, frame in zip(pictures, frames, strict=True):
        assert differing(picture, frame) < 2e-3  # of the next frame more than 3e-3


def test_other_files_are_refused_before_anything_is_drawn(tmp_path):
    with pytest.raises(ValueError, match=r"ending in \.html, \.gif, \.mp4, got motion\.avi"):
        save_recording([shown("it")], tmp_path / "motion.avi")
    assert not list(tmp_path.iterdir())
