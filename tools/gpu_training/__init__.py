"""Training of the grasp network on one GPU, for a host with many cores and few minutes.

    python -m tools.gpu_training.labelled_objects objects.xz ROOT [ROOT ...]
    python -m tools.gpu_training.train --objects objects.xz --out network.safetensors --minutes 9

`symgrasp train` draws regions in an order that a resumed run repeats to the bit. Here regions stay
on the GPU, a step is one CUDA graph, and runs are not reproducible
(docs/experiments/training-on-a-gpu.md).
"""
