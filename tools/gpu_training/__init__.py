"""Training of the grasp network on one GPU whose host has few minutes and many cores.

    python -m tools.gpu_training.labelled_objects objects.xz ROOT [ROOT ...]
    python -m tools.gpu_training.train --objects objects.xz --out network.safetensors --minutes 9

`symgrasp train` goes through regions in one order that a resumed run repeats to the bit. Here
regions stay on the GPU, a step is one CUDA graph, and no run repeats another
(docs/experiments/training-on-a-gpu.md).
"""
