"""The camera loop on any frames and on frames of a RealSense."""

import sys
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from examples import camera_loop
from pipelines.frames.cameras.camera_files import camera_from_mapping
from pipelines.frames.cameras.lens import BROWN, Distortion
from tests.examples.tabletop_frame import COLOR, DEPTH, LENS, doubtful_detector, light_detector

FRAME = camera_loop.CameraFrame(
    COLOR, DEPTH, dict(zip(("fx", "fy", "cx", "cy"), LENS, strict=True))
)
COEFFICIENTS = [-0.055, 0.065, -0.0009, 0.0005, -0.02]  # as of a D455


class LensModel:
    """librealsense's enum of models, whose text is the name."""

    def __str__(self):
        return "distortion.inverse_brown_conrady"


def test_every_frame_gives_grasps_and_a_wrong_frame_is_passed_over(capsys):
    broken = FRAME._replace(depth=np.zeros_like(DEPTH))
    whole, again = camera_loop.found([FRAME, broken, FRAME], light_detector())
    assert len(whole) == len(again) > 0
    assert "every pixel is missing" in capsys.readouterr().out


@dataclass
class Pipeline:
    """A RealSense pipeline whose frames are the same each time."""

    stopped: bool = False

    def start(self, config):
        assert {stream for stream, *_ in config.streams} == {"color", "depth"}
        sensor = SimpleNamespace(get_depth_scale=lambda: 0.001)
        device = SimpleNamespace(first_depth_sensor=lambda: sensor)
        return SimpleNamespace(get_device=lambda: device)

    def wait_for_frames(self):
        fx, fy, cx, cy = LENS
        height, width = DEPTH.shape
        lens = SimpleNamespace(fx=fx, fy=fy, ppx=cx, ppy=cy, width=width, height=height)
        lens.coeffs, lens.model = COEFFICIENTS, LensModel()
        profile = SimpleNamespace(get_intrinsics=lambda: lens)
        depth = np.round(DEPTH * 1000).astype(np.uint16)
        color = SimpleNamespace(
            get_data=lambda: COLOR,
            profile=SimpleNamespace(as_video_stream_profile=lambda: profile),
        )
        return SimpleNamespace(
            get_color_frame=lambda: color,
            get_depth_frame=lambda: SimpleNamespace(get_data=lambda: depth),
        )

    def stop(self):
        self.stopped = True


class Streams:
    """The streams that a RealSense is asked for."""

    def __init__(self):
        self.streams = []

    def enable_stream(self, *stream):
        self.streams.append(stream)


@pytest.fixture
def pipeline(monkeypatch):
    made, module = Pipeline(), ModuleType("pyrealsense2")
    module.pipeline, module.config = lambda: made, Streams
    module.stream = SimpleNamespace(color="color", depth="depth")
    module.format = SimpleNamespace(rgb8="rgb8", z16="z16")
    module.align = lambda to: SimpleNamespace(process=lambda frames: frames if to == "color" else 0)
    monkeypatch.setitem(sys.modules, "pyrealsense2", module)
    return made


def test_a_realsense_is_read_in_metres_and_stopped_at_the_end(pipeline):
    frames = camera_loop.realsense_frames()
    first, second = islice(frames, 2)
    np.testing.assert_array_equal(first.color, COLOR)
    np.testing.assert_allclose(second.depth, DEPTH, atol=0.0006)
    camera = camera_from_mapping(Path("camera"), first.intrinsics)
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == LENS
    assert camera.distortion == Distortion(BROWN, tuple(COEFFICIENTS))
    frames.close()
    assert pipeline.stopped


def test_the_loop_prints_the_best_grasp_of_each_frame(monkeypatch, capsys):
    bare = FRAME._replace(depth=np.full_like(DEPTH, 0.8))
    monkeypatch.setattr(camera_loop, "realsense_frames", lambda: iter([FRAME, bare]))
    monkeypatch.setattr(camera_loop, "GraspDetector", light_detector)
    camera_loop.main(["--gripper", "franka"])
    first, second = capsys.readouterr().out.splitlines()
    assert " grasps; best: base at " in first
    assert "nothing stands out" in second


def test_a_best_grasp_not_worth_trying_is_not_printed_as_one_to_try(monkeypatch, capsys):
    monkeypatch.setattr(camera_loop, "realsense_frames", lambda: iter([FRAME]))
    monkeypatch.setattr(camera_loop, "GraspDetector", doubtful_detector)
    camera_loop.main([])
    (line,) = capsys.readouterr().out.splitlines()
    assert line.endswith("none worth trying: move the camera")
