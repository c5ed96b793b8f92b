#!/bin/sh
# Make all default weights from nothing: tools/make_weights.sh FOLDER [full|small|tiny] [paper]
#
# The third word `paper` makes the two networks of the paper as printed, `--preset paper`, which needs
# no critics; COCO=FILE names torchvision's COCO weights for the detector to start from.
# Every step is a documented command. A finished step is skipped and an interrupted step continues, so
# that the same call resumes after a kill. `full` takes days of a core, `small` an hour and a half, and `tiny`
# minutes: its weights are useless and only show that the chain works.
set -eu

FOLDER=${1:?usage: tools/make_weights.sh FOLDER [full|small|tiny] [paper]}
SIZE=${2:-full}
METHOD=${3:-default}
SYMGRASP=${SYMGRASP:-symgrasp}

case $SIZE in
full)
    SEEDS="0 1 2" CRITIC_SEEDS="3 4 5 6" SCENES=60 CRITIC_SCENES=40 HELD_SCENES=24
    OBJECTS=72 HELD_OBJECTS=48 VIEWS=8 HELD_VIEWS=4 PIXELS=640x480 GRASP_POINTS=48
    PACK="" DETECTOR="--epochs 40 --decay-epochs 0.7"
    NETWORK="--batch-size 12 --epochs 16 --decay-epochs 0.5" CRITIC=""
    ;;
small)
    SEEDS="0" CRITIC_SEEDS="3 4" SCENES=45 CRITIC_SCENES=12 HELD_SCENES=12
    OBJECTS=60 HELD_OBJECTS=36 VIEWS=6 HELD_VIEWS=4 PIXELS=640x480 GRASP_POINTS=24
    PACK="" DETECTOR="--epochs 12 --decay-epochs 0.5"
    NETWORK="--batch-size 12 --epochs 20 --decay-epochs 0.8" CRITIC=""
    ;;
tiny)
    SEEDS="0" CRITIC_SEEDS="3" SCENES=3 CRITIC_SCENES=2 HELD_SCENES=8
    OBJECTS=6 HELD_OBJECTS=14 VIEWS=2 HELD_VIEWS=2 PIXELS=320x240 GRASP_POINTS=4
    PACK="--set num_points=400" DETECTOR="--epochs 1 --set detector.min_size=96 --set detector.max_size=128"
    NETWORK="--batch-size 4 --epochs 1 --set network.num_points=400"
    CRITIC="--epochs 1 --set infer.regions=geometric"
    ;;
*)
    echo "size is $SIZE; it must be full, small or tiny" >&2
    exit 2
    ;;
esac

case $METHOD in
default) ;;
paper)
    # The preset has the batch size and the learning rate; the epochs differ from `default`.
    NETWORK="--preset paper --epochs 40"
    DETECTOR="$DETECTOR --preset paper ${COCO:+--coco-weights $COCO}"
    [ "$SIZE" != tiny ] || NETWORK="--preset paper --batch-size 4 --epochs 1 --set network.num_points=400"
    ;;
*)
    echo "method is $METHOD; it must be default or paper" >&2
    exit 2
    ;;
esac

DATA=$FOLDER/data
# A root of procedural objects with exact symmetries: NAME SPLIT SCENES VIEWS OBJECTS GRASP_POINTS SEED.
root() {
    $SYMGRASP synthesize "$DATA/$1" --split "$2" --scenes-per-split "$3" --views "$4" --objects "$5" \
        --size "$PIXELS" --sensor mixed --no-collision-labels --grasp-points "$6" --seed "$7"
    $SYMGRASP annotate-symmetry "$DATA/$1"
}

# 1. Objects, scenes, labels, and the regions that the grasp network learns from.
TRAIN_ROOTS=""
for seed in $SEEDS; do
    root "train$seed" train "$SCENES" "$VIEWS" "$OBJECTS" "$GRASP_POINTS" "$seed"
    $SYMGRASP refine-grasps "$DATA/train$seed"
    $SYMGRASP pack "$DATA/train$seed" --out "$DATA/packed/train$seed" $PACK
    TRAIN_ROOTS="$TRAIN_ROOTS $DATA/train$seed"
done

# 2. Both networks.
$SYMGRASP finetune-detector $TRAIN_ROOTS --out "$FOLDER/detector.safetensors" $DETECTOR --resume
$SYMGRASP train "$DATA/packed" --out "$FOLDER/network.safetensors" $NETWORK --resume
NETWORKS="--detector $FOLDER/detector.safetensors --network $FOLDER/network.safetensors"
if [ "$METHOD" = paper ]; then
    echo "weights of the paper as printed: \`symgrasp infer FRAMES --preset paper $NETWORKS\`"
    exit 0
fi

# 3. The critics, each of which needs the previous ones, on objects that no network has seen.
root held similar "$HELD_SCENES" "$HELD_VIEWS" "$HELD_OBJECTS" 4 7
CRITIC_ROOTS=""
for seed in $CRITIC_SEEDS; do
    root "critic$seed" train "$CRITIC_SCENES" "$HELD_VIEWS" "$OBJECTS" 4 "$seed"
    CRITIC_ROOTS="$CRITIC_ROOTS $DATA/critic$seed"
done
$SYMGRASP train-critic axes $CRITIC_ROOTS --calibrate "$DATA/held" \
    --out "$FOLDER/axis_critic.safetensors" $NETWORKS $CRITIC --resume
AXES="--axis-critic $FOLDER/axis_critic.safetensors"
$SYMGRASP train-critic planes $CRITIC_ROOTS --calibrate "$DATA/held" \
    --out "$FOLDER/plane_critic.safetensors" $NETWORKS $AXES $CRITIC --resume
PLANES="--plane-critic $FOLDER/plane_critic.safetensors"
$SYMGRASP train-critic grasps $CRITIC_ROOTS --calibrate "$DATA/held" \
    --out "$FOLDER/grasp_critic.safetensors" $NETWORKS $AXES $PLANES $CRITIC --resume

echo "weights: $FOLDER/*.safetensors; compare them with the default ones by \`symgrasp evaluate\`,"
echo "then copy them to pipelines/weights and run \`make golden\`"
