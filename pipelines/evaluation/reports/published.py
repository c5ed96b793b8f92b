"""The paper's figures that reports show next to ours: Tables I to III and Sections III, IV.

The paper measured on GraspNet-1Billion and on a real robot; we measure on the dataset given to
`evaluate`.
"""

SOURCE = "SymmetryGrasp paper, on GraspNet-1Billion"
SOURCE_ROBOT = "SymmetryGrasp paper, on a real robot (UR-5 with RG-2)"

# The figures of each method in one table, from left to right.
Published = dict[str, tuple[float, ...]]

# Table I, grasp quality: seen, unseen.
GRASP_QUALITY: Published = {
    "Multi-Grasp": (0.061, 0.043),
    "GG-CNN": (0.078, 0.036),
    "PointNetGPD": (0.155, 0.095),
    "GraspNet": (0.291, 0.276),
    "SymmetryGrasp": (0.382, 0.297),
}
# Table II, antipodal score: seen, unseen.
ANTIPODAL_SCORE: Published = {
    "Multi-Grasp": (0.182, 0.094),
    "GG-CNN": (0.254, 0.167),
    "PointNetGPD": (0.454, 0.402),
    "GraspNet": (0.731, 0.684),
    "SymmetryGrasp": (0.809, 0.715),
}
# Table III, success rate: reflection, rotation, sphere, none.
SUCCESS_RATE: Published = {
    "Multi-Grasp": (0.23, 0.15, 0.38, 0.17),
    "GG-CNN": (0.27, 0.28, 0.35, 0.33),
    "PointNetGPD": (0.39, 0.43, 0.23, 0.19),
    "GraspNet": (0.68, 0.59, 0.61, 0.52),
    "SymmetryGrasp": (0.74, 0.68, 0.72, 0.47),
}
# Sec. IV-E, symmetry AP: reflection, rotation, sphere; [32] is SymmetryNet, [7] is geometric.
SYMMETRY_AP: Published = {
    "geometry [7]": (0.17, 0.08, 0.34),
    "SymmetryNet [32]": (0.39, 0.32, 0.58),
    "SymmetryGrasp": (0.56, 0.61, 0.73),
}
# Sec. III-D, region masks at IoU 0.5: seen, unseen.
MASK_AP50: Published = {"SymmetryGrasp": (0.72, 0.55)}
SECONDS_PER_FRAME = 0.3  # Sec. III-G, inference
