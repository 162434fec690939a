"""Motions as files that are passed on: a page that plays without a server, and films."""

import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from jaxik.atomic_file import write_atomically
from jaxik.errors import MissingExtraError
from jaxik.view.browser.server import close_server, open_server
from jaxik.view.browser.stage import ShownMotion, Stage

if TYPE_CHECKING:
    import viser
    from PIL import Image

FORMATS = (".html", ".gif", ".mp4")
_RATE = {".html": 30.0, ".gif": 12.5, ".mp4": 30.0}  # frames per second; a GIF counts in hundredths of a second
_MOST = 3000  # frames: 100 s of film; longer motions have fewer frames per second
_GIF_COLORS = 255  # with fewer, white is mixed with the palest color
_WARMING = 10  # frames that are drawn in vain at most
_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome", "msedge")
# Without a graphics card it draws in software, slowly; no sandbox, which containers run by root do not offer.
_ARGUMENTS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


def save_recording(
    motions: Sequence[ShownMotion],
    path: str | Path,
    *,
    size: tuple[int, int] = (960, 720),
    rate: float | None = None,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Save motions, side by side, as a page that plays without a server or network, or as a film.

    Films are drawn by Chromium or Chrome, which has to be installed.

    Args:
        motions: The motions.
        path: File ending in ``.html``, ``.gif`` or ``.mp4``.
        size: Width and height of a film [pixel].
        rate: Frames per second; by default 30, of a GIF 12.5; a whole number for MP4.
        progress: Function of the fraction that is done.

    Raises:
        ValueError: Another ending.
        MissingExtraError: A program or library for films is missing.
        OSError: The file cannot be written.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in FORMATS:
        raise ValueError(f"expected a file ending in {', '.join(FORMATS)}, got {Path(path).name}")
    server = open_server(port=0)
    try:
        # A film is often shown smaller than it is; a page is as large as its window.
        stage = Stage(server, motions, caption_scale=0.9 if suffix == ".html" else size[0] / 640)
        duration = max(stage.end - stage.start, 1e-3)
        count = int(np.clip(np.ceil(duration * (rate or _RATE[suffix])), 1, _MOST)) + 1
        times = np.linspace(stage.start, stage.end, count)
        if suffix == ".html":
            title = "jaxik: " + ", ".join(motion.caption for motion in motions)
            content: str | bytes = _page(stage, times, title)
        else:
            encode = _gif if suffix == ".gif" else _mp4
            with browser_client(server, size) as client:
                frames = drawn_frames(stage, client, times, size, progress)
                content = encode(frames, (count - 1) / duration, size)
    finally:
        close_server(server)
    write_atomically(path, content)


def _page(stage: Stage, times: np.ndarray, title: str) -> str:
    """The scene with its changes over time, inside the viewer's own page."""
    stage.draw(times[0])
    recording = stage.server.get_scene_serializer()
    for before, time in pairwise(times):
        recording.insert_sleep(float(time - before))
        stage.draw(float(time))
    page, plain = recording.as_html(), "".join(c for c in title if c not in "<>&")
    start, end = page.find("<title>"), page.find("</title>")
    return page if start < 0 else f"{page[:start]}<title>{plain}{page[end:]}"


def drawn_frames(
    stage: Stage,
    client: "viser.ClientHandle",
    times: np.ndarray,
    size: tuple[int, int],
    progress: Callable[[float], None] | None = None,
) -> Iterator["Image.Image"]:
    """Pictures of the scene at all times."""
    from PIL import Image

    def drawn(time: float) -> Image.Image:
        stage.draw(time)
        stage.server.flush()
        pixels = client.get_render(size[1], size[0], transport_format="png", timeout=60.0)
        picture = Image.fromarray(pixels)
        white = Image.new("RGBA", picture.size, "white")
        return Image.alpha_composite(white, picture).convert("RGB")

    before = drawn(float(times[0]))
    for _ in range(_WARMING):  # meshes and light arrive one after the other
        if (after := drawn(float(times[0]))) == before:
            break
        before = after
    for i, time in enumerate(times):
        yield drawn(float(time))
        if progress is not None:
            progress((i + 1) / len(times))


def _gif(frames: Iterator["Image.Image"], rate: float, size: tuple[int, int]) -> bytes:
    """Animation with one palette for all frames, which avoids flicker; only changes are stored."""
    from PIL import Image

    whole = list(frames)
    palette = whole[len(whole) // 2].quantize(_GIF_COLORS, dither=Image.Dither.NONE)
    first, *others = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in whole)
    with io.BytesIO() as file:
        first.save(file, "GIF", save_all=True, append_images=others, duration=1000 / rate, loop=0, optimize=True)
        return file.getvalue()


def _mp4(frames: Iterator["Image.Image"], rate: float, size: tuple[int, int]) -> bytes:
    """Film in H.264, which every browser plays."""
    import tempfile

    try:
        import imageio_ffmpeg
    except ImportError as error:
        raise MissingExtraError('films as .mp4 need imageio-ffmpeg: pip install "jaxik[record]"') from error
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "film.mp4"
        settings = {"fps": round(rate), "macro_block_size": 2, "ffmpeg_log_level": "error"}
        writer = imageio_ffmpeg.write_frames(str(file), size, **settings)
        writer.send(None)
        for frame in frames:
            writer.send(np.ascontiguousarray(frame))
        writer.close()
        return file.read_bytes()


@contextmanager
def browser_client(server: "viser.ViserServer", size: tuple[int, int]) -> Iterator["viser.ClientHandle"]:
    """A browser without a window that shows a server's page."""
    import shutil
    from time import monotonic, sleep

    try:
        from playwright.sync_api import sync_playwright
    except ImportError as error:
        raise MissingExtraError('films need playwright: pip install "jaxik[record]"') from error
    program = next(filter(None, map(shutil.which, _BROWSERS)), None)
    if program is None:
        raise MissingExtraError("films are drawn by Chromium or Chrome, which is not installed; save .html instead")
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, args=_ARGUMENTS)
        try:
            page = browser.new_page(viewport={"width": size[0], "height": size[1]})
            page.goto(f"http://localhost:{server.get_port()}")
            page.wait_for_selector("canvas")
            until = monotonic() + 30.0
            while not server.get_clients():
                if monotonic() > until:
                    raise TimeoutError("the browser does not show the page; save .html instead")
                sleep(0.05)
            page.wait_for_timeout(1500)  # until the meshes are there
            yield next(iter(server.get_clients().values()))
        finally:
            browser.close()
