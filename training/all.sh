#!/bin/sh
# Tune and train all that is shipped: hours on two cores. Stopped searches and runs resume, finished gains and policies stay.
#     pip install 'uvms-gym[cli,train]'; sh training/all.sh [FOLDER of the package's pretrained/ [FOLDER of further policies]]
set -eu
to=${1:-$(python -c "from uvms_gym.controllers.registry import PRETRAINED; print(PRETRAINED)")}
here=$(dirname "$0")
more=${2:-$here/policies}

# tune NAME ENVIRONMENT [OPTION...]
tune() {
    name=$1 env=$2
    shift 2
    grep -qs "^ \"$name\": {" "$to/${env%-*-v0}/petasus-pum/0.1s/gains.json" ||
        python "$here/tune.py" --policies "$to" --controller "$name" --env "$env" "$@"
}

# tune_scene NAME SCENE ENVIRONMENT OPTION...: gains of a classical controller on another scene
tune_scene() {
    name=$1 scene=$2 env=$3
    shift 3
    grep -qs "^ \"$name\": {" "$to/${env%-*-v0}/$scene/0.1s/gains.json" ||
        python "$here/tune.py" --policies "$to" --controller "$name" --scene "$scene" --env "$env" "$@"
}

# run FILE ENVIRONMENT [OPTION...]: the policy FILE, unless it is finished; a stopped run goes on in its folder
run() {
    file=$1 env=$2
    shift 2
    python -c 'import sys; from uvms_gym.training.finished import is_finished; sys.exit(not is_finished(sys.argv[1]))' \
        "$file" && return
    logs=out/train/${env%-*-v0}/$(basename "$file" .safetensors)
    for config in "$logs"/*/*/config.json; do
        [ ! -e "$config" ] || set -- -i "${config%/config.json}"
    done
    [ "$1" = -i ] || set -- -f "$logs" --env "$env" "$@"
    uvms train --export "$file" "$@"
}

# file NAME SEED: of a policy, without suffix
file() {
    echo "$1-$2" | tr / -
}

# policy NAME SEED ENVIRONMENT [OPTION...]: the package has training seed 0 of the rivals
policy() {
    case $1:$2 in
        ppo:0 | shac:0 | shac-distilled:0 | shac-distilled/calm:0 | */wide:0 | residual*:0) folder=$to ;;
        *) folder=$more ;;
    esac
    made=$folder/${3%-*-v0}/petasus-pum/0.1s/$(file "$1" "$2").safetensors env=$3 seed=$2
    shift 3
    run "$made" "$env" --seed "$seed" "$@"
}

# distilled NAME SEED TEACHER HISTORY STEPS EFFORT RATE: the teacher's imitation, improved under prices of effort and variation
distilled() {
    start=out/train/$(file "$1" "$2")-start.safetensors stack=frame_stack:$4
    run "$start" "$keep" --algo distill --teacher "$3" -n 800000 -params "$stack" --seed "$2"
    policy "$1" "$2" "$keep" --algo shac --start "$start" -n "$5" -params "$stack" \
        --env-kwargs "reward:{'pose':0.3,'pose_scale':0.05,'effort':$6,'action_rate':$7}"
}

# scratch NAME SEED ENVIRONMENT EFFORT RATE [OPTION...]: PPO without a teacher
scratch() {
    reward="reward:{'effort':$4,'action_rate':$5}" name=$1 of=$2 env=$3
    shift 5
    policy "$name" "$of" "$env" --algo asymmetric-ppo -params n_epochs:4 \
        -params "net_arch:[128,128]" -params "critic_arch:[128,128]" \
        --env-kwargs "$reward" "$@"
}

mkdir -p out/train
for name in pd pid pd-restoring dob/plain dob dob/still dob/calm dob/medium dob/free computed-torque mpc mpc/free dob/informed; do
    tune $name UVMS-StationKeep-Storm-v0
done
# Plans take time: fewer episodes.
plans="--generations 10 --population 12 --episodes 16 --finals 128"
for env in UVMS-StationKeep-Storm-v0 UVMS-EETrack-Storm-v0; do
    tune nmpc $env $plans
done
tune dob/wide UVMS-StationKeep-Wide-v0
for scene in bluerov2-heavy bluerov2-heavy-alpha5 bluerov2-heavy-alpha5-gripper bluerov2-heavy-two-alpha5 \
    bluerov2-alpha5-pool rexrov; do
    for name in pd dob mpc pid dob/informed; do
        tune_scene $name $scene UVMS-StationKeep-Storm-v0 --generations 20 --population 16
    done
    tune_scene nmpc $scene UVMS-StationKeep-Storm-v0 $plans
done
tune dob-adaptive UVMS-StationKeep-Wide-v0
for name in resolved resolved-pid resolved-dob resolved-dob/still resolved-dob/calm resolved-dob/medium resolved-dob/free; do
    tune $name UVMS-EETrack-Storm-v0
done
tune resolved-dob/informed UVMS-EETrack-Storm-v0
for name in resolved resolved-dob; do
    tune_scene $name bluerov2-heavy-alpha5-tool UVMS-Valve-Storm-v0 \
        --generations 12 --population 14 --episodes 48 --finals 256
done
tune resolved-dob/wide UVMS-EETrack-Wide-v0
tune resolved-adaptive UVMS-EETrack-Wide-v0

keep=UVMS-StationKeep-Storm-v0 track=UVMS-EETrack-Storm-v0
for seed in 0 1 2 3 4; do
    distilled shac-distilled $seed dob 8 3000000 0.28 0.023
    distilled shac-distilled/medium $seed dob/medium 8 3000000 0.6 0.07
    distilled shac-distilled/calm $seed dob/calm 16 6000000 1.12 0.54
    scratch ppo $seed $keep 0.3 0.1 -n 6000000 -params frame_stack:8 -params log_std:-1.5
    scratch ppo $seed $track 0.2 0.3 -n 5000000 -params frame_stack:6
done
# A memory of 7 s: averages of older observations. Prices of effort and variation of four runs in turn.
long() {
    i=1 start=$more/UVMS-StationKeep/petasus-pum/0.1s/$(file shac-distilled $1).safetensors
    [ "$1" != 0 ] || start=$to/${start#"$more/"}
    made=$more/UVMS-StationKeep/petasus-pum/0.1s/$(file shac-distilled/long $1).safetensors
    while read -r steps effort rate; do
        i=$((i + 1)) next=out/train/$(file shac-distilled/long $1)-$((i)).safetensors
        [ $i -lt 5 ] || next=$made
        run "$next" $keep --algo shac --start "$start" -n $steps --seed $1 \
            -params "frame_stack:[32,16,8,4,4,1,1,1,1,1,1,1,1]" \
            --env-kwargs "reward:{'pose':1.2,'pose_scale':0.1,'effort':$effort,'action_rate':$rate}" </dev/null
        start=$next
    done <<END
2000000 0.28 0.023
4000000 0.34 0.05
4000000 0.30 0.03
4000000 0.27 0.024
END
}
for seed in 0 1 2 3 4; do
    long $seed
done
# Tracking: PPO's policies, improved by gradients, with a memory of 4 s.
for seed in 0 1 2 3 4; do
    start=$more/UVMS-EETrack/petasus-pum/0.1s/ppo-$seed.safetensors
    [ $seed != 0 ] || start=$to/${start#"$more/"}
    policy shac/long $seed $track --algo shac --start "$start" -n 2000000 -params "frame_stack:[16,8,4,4,1,1,1,1,1,1]" \
        --env-kwargs "reward:{'effort':0.2,'action_rate':0.2}"
done
# Bound: the policy sees the true state, as late as the measurements. Prices of effort and variation of two runs in turn.
start=$to/UVMS-StationKeep/petasus-pum/0.1s/shac-distilled-0.safetensors
made=$more/UVMS-StationKeep/petasus-pum/0.1s/shac-distilled-late-0.safetensors
for prices in 0.28:0.023 0.08:0.006; do
    next=$made
    [ $prices = 0.08:0.006 ] || next=out/train/shac-distilled-late-0-start.safetensors
    run "$next" $keep --algo shac --start "$start" -n 3000000 --seed 0 -params frame_stack:8 \
        --env-kwargs "disturbance:{'base':'storm','noise':None}" \
        --env-kwargs "reward:{'pose':1.2,'pose_scale':0.1,'effort':${prices%:*},'action_rate':${prices#*:}}"
    start=$next
done
wide=UVMS-StationKeep-Wide-v0
for seed in 0 1 2 3 4; do
    start=out/train/shac-distilled-wide-$seed-start.safetensors
    run "$start" $wide --algo distill --teacher dob-adaptive -n 2400000 --seed $seed
    policy shac-distilled/wide $seed $wide --algo shac --start "$start" --n-envs 256 -n 6000000 \
        --env-kwargs "reward:{'pose':0.3,'pose_scale':0.05,'effort':0.11,'action_rate':0.05}"
done
# Tracking of vehicles known poorly, from a policy for the storm; great errors and costly episodes count for more at last.
for seed in 0 1 2 3 4; do
    start=out/train/shac-wide-$seed-start.safetensors
    run "$start" $track --algo shac --seed $seed
    wide=out/train/shac-wide-$seed-wide.safetensors
    run "$wide" UVMS-EETrack-Wide-v0 --algo shac --start "$start" --seed $seed
    policy shac/wide $seed UVMS-EETrack-Wide-v0 --algo shac --start "$wide" -n 12000000 \
        -params n_steps:200 -params change:0.02 -params priority:1.0 \
        --env-kwargs "reward:{'pose':1.0,'pose_scale':0.5,'effort':0.085,'action_rate':0.13}"
done

# One policy for any vehicle, in two runs; in the first the learning rate falls faster from 0.65 million frames on.
made=$to/UVMS-StationKeep/universal-0.safetensors start=out/train/universal-start.safetensors logs=out/train/universal
if [ ! -e "$made" ]; then
    [ -e $logs-start/checkpoint.pt ] ||
        python "$here/universal.py" --out $logs-start --vehicles 96 --frames 16000000 --stop 651000 || [ $? = 130 ]
    python "$here/universal.py" --out $logs-start --vehicles 96 --frames 5000000 --export $start
    python "$here/universal.py" --out $logs --start $start --seed 1 --vehicles 64 --frames 3000000 --rate 0.0004 \
        --spans 32 16 8 4 2 1 1 1 1 --export "$made"
fi

# Variants along the frontier, of one seed: NAME EFFORT RATE.
while read -r name effort rate; do
    scratch $name 0 $keep $effort $rate -n 6000000 -params frame_stack:8 -params log_std:-1.5
done <<END
ppo/still 0.6 1.0
ppo/calm 0.4 0.4
ppo/quick 0.1 0.03
ppo/free 0.02 0.003
END
while read -r name effort rate; do
    scratch $name 0 $track $effort $rate -n 5000000 -params frame_stack:6
done <<END
ppo/still 0.4 1.5
ppo/calm 0.3 0.8
ppo/quick 0.1 0.1
ppo/free 0.02 0.01
END
while read -r name effort rate; do
    policy $name 0 $track --algo shac --env-kwargs "reward:{'effort':$effort,'action_rate':$rate}"
done <<END
shac/still 0.2 1.5
shac/calm 0.1 0.6
shac 0.05 0.2
shac/quick 0.02 0.06
shac/free 0.005 0.01
END
distilled shac-distilled/still 0 dob/still 16 6000000 2.0 1.5
distilled shac-distilled/free 0 dob/free 8 3000000 0.03 0.002
# Panels, in contact.
for seed in 0 1 2; do
    policy shac/tool $seed UVMS-Button-Storm-v0 --algo shac -n 500000
done
# Corrections to classical controllers, by PPO of Stable-Baselines3.
policy residual/pd 0 $keep --base pd -n 3000000
policy residual 0 $keep --base dob
policy residual/resolved-dob 0 $track --base resolved-dob -n 3000000 --env-kwargs dt:0.01 --env-kwargs substeps:10
