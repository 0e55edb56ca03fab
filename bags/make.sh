#!/bin/sh
# Make the golden bags again, in this folder or in the one given as first argument.
# GRAVITY_COMP is another command for the program.
set -eu
cd "${1:-$(dirname "$0")}"
comp=${GRAVITY_COMP:-gravity_comp}

$comp synth --motion eq17 --noise 0.1 --seed 1 -o eq17_unloaded.mcap
$comp synth --motion eq17 --start 100 --noise 0.1 --seed 2 -o eq17_later.mcap
$comp synth --motion eq17 --start 200 --payload 2 --noise 0.1 --seed 3 -o eq17_2kg.mcap
$comp synth --motion random --samples 1000 --static --relative-noise 0.01 --seed 4 -o random_poses.mcap
$comp synth --motion eq15 --static -o eq15_test.mcap
