"""Colours of ImageNet, by which networks with its weights or with COCO's normalise their input."""

IMAGENET_MEAN = (0.485, 0.456, 0.406)  # of red, green and blue, 0 to 1
IMAGENET_STD = (0.229, 0.224, 0.225)  # standard deviations of the same
