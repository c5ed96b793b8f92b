"""The stages of SymGrasp, and the libraries that they use.

Stages, in workflow order; each reads files, writes files, and depends on no other stage:

===================  ==========================================  ===============================
stage                reads                                       writes
===================  ==========================================  ===============================
doctor               this machine, the default weights           nothing; prints the faults
synthesize           procedural objects, or meshes               a GraspNet-1Billion root
label_grasps         meshes                                      ROOT/models, ROOT/grasp_label
annotate_symmetry    ROOT/models                                 ROOT/symmetry/NNN.json
refine_grasps        ROOT/grasp_label, ROOT/symmetry             ROOT/affordance/NNN.h5
pack                 ROOT frames, symmetry, affordance           PACKED/scene_XXXX.h5
export_coco          ROOT frames, symmetry                       a COCO instance dataset
finetune_detector    ROOT or COCO frames, symmetry               detector.safetensors
train                PACKED, or ROOT models and labels             network.safetensors
train_critic         ROOT frames, symmetry, both networks        axis, plane, grasp critics
train_baseline       ROOT frames, rect and other grasp labels     a compared method's weights
inspect_frames       RGB-D frames of any layout                  nothing; prints a summary
convert_frames       RGB-D frames of any layout                  RGB-D frames as flat pairs
gripper              a gripper's URDF or TOML file               a gripper's TOML file, its picture
workspace            RGB-D frames of any layout                  pictures, masks; prints a box
infer                RGB-D frames, weights                       grasps.h5, overlay pictures
infer_watch          RGB-D frames as they arrive, weights        a file per frame, grasps.h5
serve                frames posted over HTTP, weights            answers with grasps
view                 grasps.h5, RGB-D frames                     OUT/index.html, a page per frame
export               grasps.h5                                   files of other tools, JSON, CSV
score_grasps         any mesh, any grasps (N, 17)                verdicts.npz
simulate             grasps.h5, ROOT                             success.json
evaluate             grasps.h5, ROOT                             report.json, report.html
evaluate_dump        grasp dumps of any detector, ROOT           report.json, report.html
compare              several report.json                         compare.json, compare.html
===================  ==========================================  ===============================

Packages, from the ground up; imports run down only (drawn by `tools/draw_map.py`):

=====  =============  ==============================================================================
level  package        subject
=====  =============  ==============================================================================
1      array_types    Types of arrays, named by their elements
1      ending         End of a process: by a signal or with its parent; temporary files are removed
1      errors         Errors that a user can fix: each says what, where, and what would be right
2      contents       Checks of file contents: types, forms and bounds; each fault is one sentence
3      configs        Settings of all stages: one frozen dataclass per stage, with units and origins
4      geometry       Geometry on arrays: transforms, cameras, clouds, symmetries; metres, radians
4      storage        Files: atomic writes, HDF5, safetensors, provenance, digests
5      tabletop       Frames of tabletop scenes: support plane, segments, regions, filled depth
5      mesh_symmetry  Symmetries of meshes: detection, verification, symmetric parts, doubt
5      runtime        Running many items: batches, worker processes, stop signals
6      frames         RGB-D frames in any layout: finding, reading, cameras, masks, workspaces
6      grasping       Grasps on arrays: grasp frame, grippers, symmetries, feasibility, ranking
6      network        The networks, in torch: PointNet++ with PIFT, and the region detector
7      dataset        A dataset root in GraspNet-1Billion's layout: meshes, labels, symmetries
7      metrics        Grasp and symmetry metrics on arrays
8      synthesis      Procedural objects, scenes, sensors and grasp labels with known truth
8      grasp_files    `grasps.h5`, its parts and tables, and gripper files
8      refinement     Symmetric copies of annotated grasps, with newly computed contacts
9      pictures       Pictures and pages of frames, grasps and symmetries
10     inference      Computation of a frame's grasps: models, regions, and runs over many frames
11     evaluation     Evaluation of grasps: ground truth, predictions, baselines, figures, tables
12     annotation     Annotation of an object: symmetries detected, given, or corrected by a person
12     health         Checks of `doctor`: packages, torch and GPU, the machine, the default weights
12     learning       Training of the region detector, the grasp network and the critics
12     serving        Grasps over HTTP: frames in POST requests, and the server that answers them
12     simulation     Simulated trials of grasps: a table with objects, a gripper, and success rates
=====  =============  ==============================================================================
"""
