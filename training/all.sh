#!/bin/sh
# Tune and train all that is shipped: hours on two cores. Interrupted searches resume, and finished policies are kept.
#     pip install 'uvms-gym[cli,train]'; sh training/all.sh [FOLDER of the package's pretrained/]
set -eu
to=${1:-$(python -c "from uvms_gym.controllers.registry import PRETRAINED; print(PRETRAINED)")}
here=$(dirname "$0")

tune() { python "$here/tune.py" --policies "$to" "$@"; }

# policy NAME SEED ENVIRONMENT [OPTION...]
policy() {
    file=$to/${3%-*-v0}/petasus-pum/0.1s/$1-$2.safetensors env=$3 seed=$2
    shift 3
    [ -e "$file" ] || uvms train --env "$env" --seed "$seed" --export "$file" "$@"
}

# distilled NAME SEED TEACHER REWARD: the teacher's imitation, and its improvement under a price on effort and variation
distilled() {
    start=out/train/$1-$2-start.safetensors
    [ -e "$start" ] || uvms train --algo distill --teacher "$3" --seed "$2" --export "$start"
    policy "$1" "$2" UVMS-StationKeep-Storm-v0 --algo asymmetric-ppo --start "$start" --env-kwargs "reward:$4"
}

mkdir -p out/train
for name in pd pid pd-restoring dob dob-delay dob-still dob-calm dob-medium dob-free computed-torque mpc dob-informed; do
    tune --controller $name
done
tune --controller dob-wide --env UVMS-StationKeep-Wide-v0
for name in resolved resolved-pid resolved-dob resolved-informed; do
    tune --controller $name --env UVMS-EETrack-Storm-v0
done
tune --controller resolved-wide --env UVMS-EETrack-Wide-v0

for seed in 0 1 2 3 4; do
    distilled ppo-distilled $seed dob-delay "{'effort':0.1,'action_rate':0.1}"
    distilled ppo-distilled-calm $seed dob-calm "{'effort':0.5,'action_rate':0.45}"
    policy ppo $seed UVMS-EETrack-Storm-v0 --env-kwargs dt:0.01 --env-kwargs substeps:10
done
start=out/train/ppo-distilled-wide-0-start.safetensors
[ -e "$start" ] || uvms train --algo distill --env UVMS-StationKeep-Wide-v0 --teacher dob-wide --seed 0 --export "$start"
policy ppo-distilled-wide 0 UVMS-StationKeep-Wide-v0 --algo asymmetric-ppo --start "$start" --n-envs 512 -n 6000000 \
    --env-kwargs "reward:{'effort':0.05,'action_rate':0.1}"
policy ppo 0 UVMS-StationKeep-Storm-v0
policy ppo-pd 0 UVMS-StationKeep-Storm-v0 --base pd -n 3000000
policy ppo-dob 0 UVMS-StationKeep-Storm-v0 --base dob-delay
policy ppo-resolved-dob 0 UVMS-EETrack-Storm-v0 --base resolved-dob -n 3000000 --env-kwargs dt:0.01 --env-kwargs substeps:10
