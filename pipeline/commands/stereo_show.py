"""`beemap stereo show`: what stereo makes of a pair, to look at."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pipeline.errors import InputError
from pipeline.progress import progress_bar

if TYPE_CHECKING:
    from collections.abc import Sequence

    import cv2
    import numpy as np

    from calibration.rig import StereoRig
    from pipeline.recordings.base import Pair, Recording
    from pipeline.settings import Settings
    from stereo.pair import StereoPair
    from stereo.ranger import StereoFrame, StereoRanger

CODECS = {".mp4": "mp4v", ".avi": "MJPG"}
FASTEST = 30.0  # frames a second that players show


@click.command()
@click.argument("recording", type=click.Path(path_type=Path), metavar="RECORDING")
@click.option(
    "--frame", type=click.IntRange(min=0), help="Number of the pair. [default: the middle one]"
)
@click.option("-o", "--output", type=click.Path(path_type=Path), metavar="PNG", help="The picture.")
@click.option(
    "--video",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="All pairs as a film, .mp4 or .avi.",
)
@click.option("--rig", type=click.Path(path_type=Path), help="Wins over the recording's own.")
@click.option("--settings", "settings_file", type=click.Path(path_type=Path), help="YAML settings.")
@click.option("--set", "overrides", multiple=True, metavar="STAGE.KEY=VALUE", help="One setting.")
@click.option("--force", is_flag=True, help="Replace files that are there.")
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
def show(
    recording: Path,
    frame: int | None,
    output: Path | None,
    video: Path | None,
    rig: Path | None,
    settings_file: Path | None,
    overrides: tuple[str, ...],
    force: bool,
    quiet: bool,
) -> None:
    """Draw a pair as stereo sees it: as a picture (-o), or all of them as a film (--video).

    The rectified images with lines on which each point must lie in both, the depth, the pixels
    that the ranges rest on, and the scan from above with its doubt; the true scan, too, where the
    recording was rendered.

    \b
    beemap stereo show REC --frame 100 -o pair.png
    beemap stereo show REC --video film.mp4
    """
    from pipeline.new_files import check_free
    from pipeline.recordings import open_recording
    from pipeline.rig import choose_rig
    from pipeline.settings import load_settings

    targets = [target for target in (output, video) if target is not None]
    if not targets:
        raise click.UsageError("give -o PNG for a picture, or --video FILE for a film")
    if output is not None and output.suffix.lower() != ".png":
        raise InputError(f"{output}: a picture is a .png file: choose that ending")
    if video is not None and video.suffix.lower() not in CODECS:
        raise InputError(f"{video}: a film is a .mp4 or .avi file: choose one of these endings")
    check_free(targets, force)
    settings = load_settings(settings_file, overrides)
    opened = open_recording(recording)
    chosen, notes = choose_rig(opened, rig)
    if not quiet:
        for note in notes:
            click.echo(f"note: {note}", err=True)
    artist = _Artist(opened, chosen, settings)
    if output is not None:
        number = len(opened.pairs) // 2 if frame is None else frame
        if number >= len(opened.pairs):
            raise InputError(
                f"--frame {number}: {recording} holds pairs 0 to {len(opened.pairs) - 1}"
            )
        words = _picture(artist, number, output, force)
        if not quiet:
            click.echo(f"pair {number}: {words}")
    if video is not None:
        with progress_bar("filming", "pairs", quiet) as progress:
            skipped = _film(artist, video, force, progress)
        if skipped and not quiet:
            from pipeline.recordings.base import counted

            click.echo(f"skipped: unreadable pair: {counted(skipped)}")


class _Artist:
    """Ranges and draws pairs of one recording."""

    def __init__(self, recording: Recording, rig: StereoRig, settings: Settings):
        from pipeline.run import USABLE_CELLS
        from pipeline.stereo_picture import StereoPicture
        from pipeline.stereo_truth import SCANS, RenderedTruth, rendered_scans
        from stereo.ranger import StereoRanger

        self.recording = recording
        usable = USABLE_CELLS * settings.mapping.cell
        self.ranger: StereoRanger = StereoRanger(
            rig, settings.stereo, settings.mapping.max_range, usable_sigma=usable
        )
        scans = rendered_scans(recording)
        self._truth = RenderedTruth(scans, recording.path / SCANS) if scans else None
        self._picture = StereoPicture(self.ranger)

    def range(self, files: Pair) -> tuple[StereoPair, StereoFrame] | Exception:
        """The pair with what was made of it, or why that cannot be."""
        from pipeline.frontend import IMAGE_ERRORS

        try:
            pair = files.load()
            return pair, self.ranger.frame(pair)
        except IMAGE_ERRORS as error:
            return error

    def draw(self, number: int, pair: StereoPair, frame: StereoFrame) -> tuple[np.ndarray, str]:
        """The picture (H, W, 3) BGR and what the scan says in words."""
        from pipeline.stereo_picture import in_words

        truth = self._truth(frame.scan) if self._truth else None
        seconds = (pair.stamp - self.recording.pairs[0].stamp) / 1e9
        title = (
            f"{self.recording.path.name}: pair {number} of {len(self.recording.pairs)}, "
            f"{seconds:.1f} s after the first"
        )
        return self._picture.draw(pair, frame, truth, title), in_words(frame.scan, truth)


def _picture(artist: _Artist, number: int, output: Path, force: bool) -> str:
    import cv2

    from pipeline.new_files import new_files

    found = artist.range(artist.recording.pairs[number])
    if isinstance(found, Exception):
        raise found
    picture, words = artist.draw(number, *found)
    with new_files([output], force) as partial:
        if not cv2.imwrite(str(partial / output.name), picture):
            raise InputError(f"{output}: cannot be written: is the disk full?")
    return words


def _film(artist: _Artist, video: Path, force: bool, progress) -> list[str]:
    """Write all pairs; what could not be read, by reason."""
    import cv2

    from pipeline.frontend import ahead
    from pipeline.new_files import new_files

    pairs = artist.recording.pairs
    skipped: list[str] = []
    writer: cv2.VideoWriter | None = None
    cv2.setNumThreads(1)  # pairs are ranged beside each other
    with new_files([video], force) as partial:
        target = partial / video.name
        frames = ahead(pairs, artist.range, os.cpu_count() or 1)
        for number, (_, found) in enumerate(frames):
            progress(number + 1, len(pairs))
            if isinstance(found, Exception):
                skipped.append(str(found))
                continue
            picture, _ = artist.draw(number, *found)
            if writer is None:
                writer = _writer(target, video, picture, _rate(pairs))
            writer.write(picture)
        if writer is None:
            raise InputError(
                f"{artist.recording.path}: none of {len(pairs)} pairs can be shown: {skipped[0]}"
            )
        writer.release()
    return skipped


def _writer(target: Path, video: Path, picture: np.ndarray, rate: float) -> cv2.VideoWriter:
    import cv2

    codec = cv2.VideoWriter.fourcc(*CODECS[video.suffix.lower()])
    height, width = picture.shape[:2]
    writer = cv2.VideoWriter(str(target), codec, rate, (width, height))
    if not writer.isOpened():
        raise InputError(f"{video}: this OpenCV cannot write it: try the other of .mp4 and .avi")
    return writer


def _rate(pairs: Sequence[Pair]) -> float:
    """Pairs a second of the recording."""
    import numpy as np

    if len(pairs) < 2:
        return 1.0
    step = float(np.median(np.diff([pair.stamp for pair in pairs]))) / 1e9
    return min(max(1.0 / step, 1.0), FASTEST) if step > 0 else FASTEST
