"""Kinds of images in ROS messages, by topic and encoding."""

from types import SimpleNamespace

import pytest

from pipelines.frames.encodings.ros_images import shown_by


@pytest.mark.parametrize(
    ("topic", "encoding", "kind"),
    [
        ("/camera/ir/image_raw", "mono16", ""),
        ("/ir/image_raw", "mono16", ""),
        ("/kinect2/qhd/image_ir_rect", "16UC1", ""),
        ("/camera/infra1/image_rect_raw", "mono16", ""),
        ("/camera/depth/image_rect_raw", "16UC1", "depth"),
        ("/camera/aligned_depth_to_infra1/image_raw", "16UC1", "depth"),
        ("/stairs/air/image", "16UC1", "depth"),
        ("/ir/image_raw", "rgb8", "color"),
    ],
)
def test_infrared_images_of_16_bits_are_no_depth(topic: str, encoding: str, kind: str) -> None:
    assert shown_by(topic, SimpleNamespace(encoding=encoding)) == kind
