"""Networks, OpenCV and numpy use one core while frames are processed; choice of device."""

from threading import Event, Thread

import cv2
import numpy as np
import torch
from threadpoolctl import threadpool_info, threadpool_limits

from pipelines.inference import models
from pipelines.inference.models import one_thread_each, uses_gpu


def threads():
    a = np.ones((4, 4))
    a @ a  # so that its library is there
    products = [each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"]
    return torch.get_num_threads(), cv2.getNumThreads(), max(products)


def test_all_libraries_use_one_core_in_the_context_and_as_many_as_before_afterwards():
    with threadpool_limits(limits=2, user_api="blas"):
        before = threads()
        with one_thread_each():
            assert threads() == (1, 1, 1)
            with one_thread_each():  # of another frame
                assert threads() == (1, 1, 1)
            assert threads() == (1, 1, 1)
        assert threads() == before
        assert before[2] == 2


def test_libraries_stay_on_one_core_until_the_last_thread_has_left_the_context():
    before = threads()
    inside, others_left = Event(), Event()
    seen = []

    def late():
        with one_thread_each():
            inside.set()
            others_left.wait()
            seen.append(threads())
        seen.append(threads())

    with threadpool_limits(limits=2, user_api="blas"):
        cv2.setNumThreads(2)
        torch.set_num_threads(3)
        try:
            thread = Thread(target=late)
            with one_thread_each():
                thread.start()
                inside.wait()
            here = torch.get_num_threads()
            others_left.set()
            thread.join()
            after = threads()
        finally:
            torch.set_num_threads(before[0])
            cv2.setNumThreads(before[1])
    assert seen == [(1, 1, 1), (3, 2, 2)]
    assert here == 3
    assert after == (3, 2, 2)


def test_a_thread_enters_the_context_while_another_limits_its_own_matrix_products():
    seen = []

    def other():
        with one_thread_each():
            seen.append(threads())

    with threadpool_limits(limits=2, user_api="blas"):
        thread = Thread(target=other)
        thread.start()
        thread.join()
        assert threads()[2] == 2
    assert seen == [(1, 1, 1)]


def test_a_gpu_is_used_if_it_is_requested_or_found_by_torch(monkeypatch, tmp_path):
    assert uses_gpu("cuda:0")
    assert not uses_gpu("cpu")
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 1)
    for driver, found in ((tmp_path, True), (tmp_path / "none", False)):
        monkeypatch.setattr(models, "DRIVERS", (str(driver),))
        assert uses_gpu("auto") == found
