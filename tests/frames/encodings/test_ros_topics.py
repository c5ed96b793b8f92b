"""The colour topic that the depth is aligned to, among several."""

import numpy as np
import pytest

from pipelines.frames.encodings.ros_topics import Calibration, cameras_of_topics

SIZE = (640, 480)
ALIGNED = "/c/aligned_depth_to_color/image_raw"


def calibration(focal: float, *distortion: float, size: tuple[int, int] = SIZE) -> Calibration:
    K = np.array([[focal, 0.0, 320.0], [0.0, focal, 240.0], [0.0, 0.0, 1.0]])
    return Calibration(size, K, np.zeros((3, 3)), distortion)


@pytest.mark.parametrize(
    ("expected", "others", "depth"),
    [
        # Both sides of a ZED, whose depth is registered to the left side.
        ("/zed/left/image_rect_color", ["/zed/right/image_rect_color"],
         "/zed/depth/depth_registered"),
        ("/zed/rgb/color/rect/image", ["/zed/left/color/rect/image", "/zed/right/color/rect/image"],
         "/zed/depth/depth_registered"),
        # Azure Kinect: each image in its own camera, and aligned to the other.
        ("/rgb/image_raw", ["/rgb_to_depth/image_raw"], "/depth_to_rgb/image_raw"),
        ("/rgb_to_depth/image_raw", ["/rgb/image_raw"], "/depth/image_raw"),
        # Images with and without distortion.
        ("/c/color/image_raw", ["/c/color/image_rect_color"], ALIGNED),
        ("/c/rgb/image_rect_color", ["/c/rgb/image_color"],
         "/c/depth_registered/hw_registered/image_rect"),
        # The name of the depth states its image.
        ("/c/infra1/image_raw", ["/c/color/image_raw"], "/c/aligned_depth_to_infra1/image_raw"),
        ("/color_aligned_l", ["/color_aligned_r"], "/depth_aligned_l"),
    ],
)  # fmt: skip
def test_depth_pairs_with_the_colour_that_it_is_aligned_to(
    expected: str, others: list[str], depth: str
) -> None:
    (camera,) = cameras_of_topics([*others, expected], [depth], {})
    assert camera.color == expected
    assert not camera.rivals


def test_depth_pairs_with_the_colour_of_its_camera_info() -> None:
    stated = {
        "/c/one/camera_info": calibration(500.0),
        "/c/two/camera_info": calibration(600.0),
        "/c/small/camera_info": calibration(600.0, size=(320, 240)),
        "/c/registered/camera_info": calibration(600.0),
    }
    colors = [f"/c/{name}/image_raw" for name in ("one", "small", "two")]
    (camera,) = cameras_of_topics(colors, ["/c/registered/image"], stated)
    assert camera.color == "/c/two/image_raw"
    assert not camera.rivals


@pytest.mark.parametrize(("distortion", "expected"), [(0.0, "image_rect"), (0.1, "image_raw")])
def test_depth_without_distortion_pairs_with_rectified_colour(
    distortion: float, expected: str
) -> None:
    infos = ("/c/registered/camera_info", "/c/color/camera_info")
    stated = dict.fromkeys(infos, calibration(600.0, distortion))
    colors = ["/c/color/image_raw", "/c/color/image_rect"]
    (camera,) = cameras_of_topics(colors, ["/c/registered/image"], stated)
    assert camera.color == f"/c/color/{expected}"


def test_colours_that_fit_alike_are_named() -> None:
    (camera,) = cameras_of_topics(["/c/b/image", "/c/a/image"], ["/c/aligned_depth/image"], {})
    assert (camera.color, camera.rivals) == ("/c/a/image", ("/c/b/image",))
