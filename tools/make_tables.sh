#!/bin/sh
# The paper's tables on one data set, from nothing: tools/make_tables.sh FOLDER [full|tiny] [DATASET]
#
# FOLDER/report.html and report.json hold Tables I to IV and Sec. IV-E: ours, the paper as printed, the
# compared methods, the controls, and the cost of each. DATASET is a root in GraspNet-1Billion's layout,
# with symmetries and affordance labels (annotate-symmetry, refine-grasps); by default the set of `make
# dev` is made.
# Every step is a documented command. A finished step is skipped and an interrupted step continues, so
# that the same call resumes after a kill. `tiny` takes minutes; its figures are meaningless.
# Weights at FOLDER/weights/NAME.safetensors replace trained weights if they exist before the call, and
# tables FOLDER/table-iv*.json, in the format of `evaluate --table`, replace Table IV. Without
# table-iv.json the networks of Table IV are trained; TABLE_IV=no leaves this out.
set -eu

FOLDER=${1:?usage: tools/make_tables.sh FOLDER [full|tiny] [DATASET]}
SIZE=${2:-full}
DATASET=${3:-}
SYMGRASP=${SYMGRASP:-symgrasp}
PYTHON=${PYTHON:-python3}
METHODS="multi-grasp gg-cnn pointnetgpd graspnet"
TRAINED="$METHODS symmetrynet"

case $SIZE in
full)
    SCENES=60 VIEWS=8 OBJECTS=72 PIXELS=640x480 GRASP_POINTS=400
    DEV="--families wide --scenes-per-split 24 --views 4 --objects 96 --grasp-points 48
        --surroundings plain,plain,bin,tray,wall,edge"
    TRAINING="" PACK="" NETWORK="--epochs 40" ABLATIONS=""
    echo "this takes one or two days of two cores; some two hours with all weights and Table IV given" >&2
    ;;
tiny)
    SCENES=3 VIEWS=2 OBJECTS=6 PIXELS=320x240 GRASP_POINTS=40
    DEV="--scenes-per-split 1 --views 1 --objects 6 --grasp-points 8"
    TRAINING="--steps 4" PACK="--set num_points=400"
    NETWORK="--batch-size 4 --epochs 1 --set network.num_points=400"
    ABLATIONS="--rows no-pift --steps 4 --detector-steps 2 --scenes 3 --views 2 --objects 6"
    ;;
*)
    echo "size is $SIZE; it must be full or tiny" >&2
    exit 2
    ;;
esac

DATA=$FOLDER/data
WEIGHTS=$FOLDER/weights
mkdir -p "$WEIGHTS"
# A root of procedural objects: NAME SEED OPTIONS.
root() {
    folder=$DATA/$1 seed=$2
    shift 2
    $SYMGRASP synthesize "$folder" --size "$PIXELS" --sensor mixed --seed "$seed" "$@"
    $SYMGRASP annotate-symmetry "$folder"
    $SYMGRASP refine-grasps "$folder"
}

# 1. The set to evaluate on.
if [ -z "$DATASET" ]; then
    root dev 700 --split similar,novel $DEV --no-collision-labels
    DATASET=$DATA/dev
fi

# 2. The compared methods and the paper as printed, all on the same frames of the same objects.
given() { [ -e "$WEIGHTS/$1.safetensors" ] && [ ! -e "$WEIGHTS/$1.checkpoint.safetensors" ]; }
all_given() { for name in "$@"; do given "$name" || return 1; done; }
if ! all_given $TRAINED as-printed; then
    root train 0 --split train --scenes-per-split "$SCENES" --views "$VIEWS" --objects "$OBJECTS" \
        --grasp-points "$GRASP_POINTS" --collision-labels
    for name in $TRAINED; do
        given "$name" && continue
        $SYMGRASP train-baseline "$name" "$DATA/train" --out "$WEIGHTS/$name.safetensors" $TRAINING --resume
    done
    if ! given as-printed; then
        $SYMGRASP pack "$DATA/train" --out "$DATA/packed" $PACK
        $SYMGRASP train "$DATA/packed" --out "$WEIGHTS/as-printed.safetensors" --preset paper $NETWORK --resume
    fi
fi

# 3. Grasps of every row on the same frames, and their trials in simulation.
WITH=""
row() {
    grasps=$FOLDER/rows/$1.h5 success=$FOLDER/rows/$1.success.json
    if [ "$1" = ours ]; then
        BASELINES=--baselines
    else
        BASELINES="" WITH="$WITH --with $grasps"
    fi
    WITH="$WITH --success $success"
    shift
    $SYMGRASP infer "$DATASET" --split all --out "$grasps" --timings "$@"
    $SYMGRASP simulate "$grasps" --dataset "$DATASET" --out "$success" --friction 0.5 $BASELINES
}
row ours
row as-printed --preset paper --network "$WEIGHTS/as-printed.safetensors"
for name in $METHODS; do
    row "$name" --method "$name" --weights "$WEIGHTS/$name.safetensors"
    row "$name-selected" --method "$name" --weights "$WEIGHTS/$name.safetensors" --set selects_for_compared_methods=true
done
row symmetrynet --method symmetrynet --weights "$WEIGHTS/symmetrynet.safetensors"
row symmetry-icp --method symmetry-icp
CONTROLS="random-network constant-affordance"
for name in $CONTROLS; do
    $PYTHON -m tools.controls "$name" "$WEIGHTS/$name.safetensors"
    row "$name" --network "$WEIGHTS/$name.safetensors"
done
$PYTHON -m tools.controls true-regions "$FOLDER/true_regions" "$DATASET"
row true-regions --masks "$FOLDER/true_regions"

# 4. Table IV: networks without one part each.
TABLES="--table $FOLDER/costs.json"
if [ ! -e "$FOLDER/table-iv.json" ] && [ "${TABLE_IV:-yes}" != no ]; then
    $PYTHON -m benchmarks.ablations "$DATASET" --out "$FOLDER/ablations" $ABLATIONS
    TABLES="$TABLES --table $FOLDER/ablations/table.json"
fi
for table in "$FOLDER"/table-iv*.json; do
    [ ! -e "$table" ] || TABLES="$TABLES --table $table"
done

# 5. Evaluation of all rows; a report older than a row or than Table IV is made again.
$PYTHON -m tools.row_costs "$FOLDER"
later() { find "$FOLDER/rows" "$FOLDER"/table-iv*.json -type f ! -name ".*" -newer "$FOLDER/report.json" 2>/dev/null; }
[ -z "$(later)" ] || rm "$FOLDER/report.json"
$SYMGRASP evaluate "$FOLDER/rows/ours.h5" --dataset "$DATASET" --out "$FOLDER/report.json" \
    --baselines $WITH $TABLES
echo "report: $FOLDER/report.html"
