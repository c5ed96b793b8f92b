"""Tensors with numbers that pretend to lie on a GPU, on machines that have none.

Tensors moved to it stay in this machine's memory and are recorded; results of operations on them
are recorded too. As on a GPU, errors are raised by: tensors of both places in one operation, except
single numbers and indices on the CPU into a tensor on the GPU; arrays of tensors on the GPU; and
random numbers on the GPU from a CPU generator. Only the thread that enters the context sees it.
"""

from contextlib import contextmanager

import pytest
import torch
from torch.overrides import TorchFunctionMode
from torch.utils._python_dispatch import TorchDispatchMode

GPU, CPU = torch.device("cuda", 0), torch.device("cpu")
MOVES = {"copy_", "_to_copy", "_foreach_copy_"}
INDEXED = {"index", "index_put", "index_put_", "_index_put_impl_", "_unsafe_index_put"}
JOINED = {"cat", "stack"}  # these take no single numbers from the other place either
ARRAYS = {torch.Tensor.numpy, torch.Tensor.__array__}
DEVICE, IS_CUDA = torch.Tensor.device.__get__, torch.Tensor.is_cuda.__get__
PLACES = {DEVICE, IS_CUDA}
MOVED = {torch.Tensor.cuda, torch.Tensor.cpu}
SEQUENCES = (list, tuple)
BESIDE = {torch.Tensor.__deepcopy__, torch.Tensor.new_tensor}  # make tensors without operations


def tensors_of(*trees):
    """The tensors in lists, tuples and dictionaries; torch's own search is three times slower."""
    found = []
    for tree in trees:
        if isinstance(tree, torch.Tensor):
            found.append(tree)
        elif isinstance(tree, SEQUENCES):
            found += tensors_of(*tree) if tree else ()
        elif isinstance(tree, dict):
            found += tensors_of(*tree.values()) if tree else ()
    return found


class Memory:
    """The tensors on the pretended GPU, by storage; a recorded storage is kept alive."""

    def __init__(self):
        self.there = {}
        self.trusted = False  # torch's own functions make tensors where their arguments are

    def _storage(self, tensor):
        with torch._C.DisableTorchFunction():
            return tensor.untyped_storage()

    def holds(self, tensor):
        return self._storage(tensor)._cdata in self.there

    def take(self, *trees):
        for tensor in tensors_of(*trees):
            storage = self._storage(tensor)
            self.there[storage._cdata] = storage

    def moved(self, tensor, to_gpu):
        if self.holds(tensor) == to_gpu:
            return tensor
        made = torch.Tensor.clone(tensor)
        if to_gpu:
            self.take(made)
        else:
            self.there.pop(self._storage(made)._cdata, None)
        return made


class Operations(TorchDispatchMode):
    """Refuses operations on tensors of both places, and records the place of their results."""

    def __init__(self, memory):
        super().__init__()
        self.memory = memory

    @classmethod
    def _should_skip_dynamo(cls):
        return False  # nothing is compiled here, and the guard against it is slow

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        kwargs, name = kwargs or {}, func._schema.name.split("::")[1]
        given = tensors_of(args, kwargs)
        there = [self.memory.holds(each) for each in given]
        self._check(name, args, given, there)
        made = func(*args, **kwargs)
        if name != "copy_" and (any(there) or (self.memory.trusted and not given)):
            _check_generator(name, kwargs)
            self.memory.take(made)
        return made

    def _check(self, name, args, given, there):
        if name in MOVES or len(set(there)) < 2:
            return
        if name in INDEXED and self.memory.holds(args[0]):
            values = tensors_of(args[2:])
            if all(self.memory.holds(each) or not each.dim() for each in values):
                return
        pairs = list(zip(given, there, strict=True))
        if {place for each, place in pairs if each.dim() or place or name in JOINED} != {True}:
            where = [(tuple(each.shape), "cuda" if place else "cpu") for each, place in pairs]
            raise RuntimeError(f"{name}: tensors on different devices, {where}")


class Calls(TorchFunctionMode):
    """Answers queries for the device of tensors, and moves them."""

    def __init__(self, memory):
        super().__init__()
        self.memory = memory

    def __torch_function__(self, func, types, args=(), kwargs=None):
        if func.__name__ == "__get__" and func not in PLACES:  # a shape or a dtype
            return func(*args)
        kwargs, memory = dict(kwargs or {}), self.memory
        there = any(memory.holds(each) for each in tensors_of(args, kwargs))
        if func == DEVICE:
            return GPU if there else func(*args)
        if func == IS_CUDA:
            return there
        if func in ARRAYS and there:
            raise TypeError("can't convert a tensor on cuda:0 to an array")
        if func in MOVED:
            return memory.moved(args[0], func is torch.Tensor.cuda)
        if func is torch.Tensor.to:
            return self._to(*args, **kwargs)
        if (device := kwargs.get("device")) is not None:
            kwargs["device"], there = CPU, torch.device(device).type == "cuda"
        if there:
            _check_generator(func.__name__, kwargs)
        before, memory.trusted = memory.trusted, there
        try:
            made = func(*args, **kwargs)
        finally:
            memory.trusted = before
        if there and (device is not None or func in BESIDE):
            memory.take(made)
        return made

    def _to(self, tensor, *args, device=None, dtype=None, memory_format=None, **others):
        to_gpu = was_there = self.memory.holds(tensor)
        for each in (*args, device):
            if isinstance(each, torch.Tensor):
                to_gpu, dtype = self.memory.holds(each), each.dtype
            elif isinstance(each, torch.dtype):
                dtype = each
            elif isinstance(each, str | torch.device):
                to_gpu = torch.device(each).type == "cuda"
        layout = {} if memory_format is None else {"memory_format": memory_format}
        changed = torch.Tensor.to(tensor, dtype=dtype or tensor.dtype, **layout)
        if was_there:
            self.memory.take(changed)
        changed = self.memory.moved(changed, to_gpu)
        return torch.Tensor.clone(changed) if others.get("copy") and changed is tensor else changed


def _check_generator(name, options):
    generator = options.get("generator")
    if generator is not None and generator.device.type == "cpu":
        raise RuntimeError(f"{name}: a generator of the CPU draws on the GPU")


@contextmanager
def pretended_gpu():
    """Pretend that there is one GPU for this thread, as long as the context lasts."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(torch.cuda, "is_available", lambda: True)
        patch.setattr(torch.cuda, "device_count", lambda: 1)
        graphs = "_accelerator_graph_capture_health_check"  # would ask the driver
        patch.setattr(torch.optim.Optimizer, graphs, lambda _: None)
        # Two threads of an operation wait for each other longer than toy networks take.
        patch.setattr(torch, "set_num_threads", lambda _: None)
        memory = Memory()
        with Calls(memory), Operations(memory):
            yield memory
