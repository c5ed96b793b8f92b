"""The stages of SymGrasp, and the libraries they stand on.

Stages, in workflow order; each reads files, writes files, and knows no other stage:

===================  ==========================================  ===============================
stage                reads                                       writes
===================  ==========================================  ===============================
doctor               this machine, the default weights           nothing; says what is wrong
synthesize           procedural objects, or meshes               a GraspNet-1Billion root
label_grasps         meshes                                      ROOT/models, ROOT/grasp_label
annotate_symmetry    ROOT/models                                 ROOT/symmetry/NNN.json
refine_grasps        ROOT/grasp_label, ROOT/symmetry             ROOT/affordance/NNN.h5
pack                 ROOT frames, symmetry, affordance           PACKED/scene_XXXX.h5
export_coco          ROOT frames, symmetry                       a COCO instance dataset
finetune_detector    ROOT or COCO frames, symmetry               detector.safetensors
train                PACKED, or ROOT models and labels             network.safetensors
inspect              RGB-D frames of any layout                  nothing; says what they are
convert_frames       RGB-D frames of any layout                  RGB-D frames as flat pairs
infer                RGB-D frames, both weights                  grasps.h5, overlay pictures
infer_watch          RGB-D frames as they come, weights          a file a frame, grasps.h5
view                 grasps.h5, RGB-D frames                     OUT/index.html, a page a frame
export               grasps.h5                                   files of other tools, JSON, CSV
score_grasps         any mesh, any grasps (N, 17)                verdicts.npz
simulate             grasps.h5, ROOT                             success.json
evaluate             grasps.h5, ROOT                             report.json, report.html
evaluate_dump        grasp dumps of any detector, ROOT           report.json, report.html
compare              several report.json                         compare.json, compare.html
===================  ==========================================  ===============================

Libraries, from the ground up: `errors`, `configs`, `geometry` and `network`, `grasping`,
`formats` and `metrics`, `synthesis`, `evaluation` and `health`, `simulation`, `clusters`,
`learning` and `batch`, `annotation` and `refinement`. Imports run down only.
"""
