"""Results of torch and torchvision against known results."""

import subprocess

import pytest
import torch
import torchvision.ops

from pipelines.health import torch_checks
from pipelines.health.checks import Status


def test_correct_operators_pass():
    assert torch_checks.operator_check().status is Status.OK


@pytest.mark.parametrize(
    ("name", "answer"),
    [("nms", torch.tensor([0, 1, 2])), ("roi_align", torch.zeros(1, 1, 2, 2))],
)
def test_wrong_operators_fail_by_name(monkeypatch, name, answer):
    monkeypatch.setattr(torchvision.ops, name, lambda *arguments, **options: answer)
    check = torch_checks.operator_check()
    assert check.status is Status.FAIL
    assert name in check.text


def test_a_correct_product_on_the_cpu_passes_and_a_wrong_one_is_detected(monkeypatch):
    assert torch_checks.product_error("cpu") < 1e-5
    right = torch.Tensor.to
    monkeypatch.setattr(torch.Tensor, "to", lambda self, device: right(self * 1.001, device))
    assert torch_checks.product_error("cpu") > 1e-3


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_a_gpu_is_named_and_its_products_agree_with_the_cpu():
    checks = list(torch_checks.gpu_checks(1e-4))
    assert {check.status for check in checks} == {Status.OK}
    assert torch.cuda.get_device_name(0) in checks[0].text


def without_gpu(monkeypatch, printed):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr(torch_checks.shutil, "which", lambda name: "/usr/bin/nvidia-smi")

    def answer(command, **options):
        if printed is None:
            raise subprocess.CalledProcessError(9, command)
        return subprocess.CompletedProcess(command, 0, printed, "")

    monkeypatch.setattr(torch_checks.subprocess, "run", answer)
    return list(torch_checks.gpu_checks(1e-4))


def test_without_a_gpu_the_cpu_is_used_and_the_check_passes(monkeypatch):
    (check,) = without_gpu(monkeypatch, None)
    assert (check.status, check.text) == (Status.OK, "none, the CPU is used")


def test_a_gpu_that_torch_cannot_use_gives_a_warning(monkeypatch):
    (check,) = without_gpu(monkeypatch, "NVIDIA T4, 470.57\n")
    assert check.status is Status.WARN
    assert check.text.startswith("NVIDIA T4, 470.57 is there, but torch")
