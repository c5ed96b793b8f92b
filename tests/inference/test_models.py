"""Networks, OpenCV and numpy keep to one core while frames are worked on side by side."""

import cv2
import numpy as np
import torch
from threadpoolctl import threadpool_info, threadpool_limits

from pipelines.inference.models import one_thread_each


def threads():
    a = np.ones((4, 4))
    a @ a  # so that its library is there
    products = [each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"]
    return torch.get_num_threads(), cv2.getNumThreads(), max(products)


def test_everything_uses_one_core_within_and_what_it_used_before_after():
    with threadpool_limits(limits=2, user_api="blas"):
        before = threads()
        with one_thread_each():
            assert threads() == (1, 1, 1)
            with one_thread_each():  # of another frame
                assert threads() == (1, 1, 1)
            assert threads() == (1, 1, 1)
        assert threads() == before
        assert before[2] == 2
