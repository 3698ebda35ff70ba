#!/bin/bash
# Everything that a borrowed machine with an NVIDIA GPU is for, in one call: check the backend against the CPU, measure
# the whole loop, then train what stands first in a queue until the time is over.
#
#   scripts/gpu.sh SECONDS OUT [WHEELS]
#
# SECONDS  how long all of it may take
# OUT      where logs and, every two minutes, checkpoints go
# WHEELS   a folder of wheels, for a machine without a package index
#
# The queue is scripts/gpu-queue.txt: one mimicbench command a line, without `mimicbench` and `--device`. A training that
# was cut off goes on where it was, if the work folder (WORKDIR, by default `work`) was kept.
set -u
seconds=$1 out=$2 wheels=${3:-}
device=${DEVICE:-cuda} workdir=${WORKDIR:-work} venv=${VENV:-.venv-gpu}
start=$(date +%s)
cd "$(dirname "$0")/.."
mkdir -p "$out"

left() { echo $((seconds - ($(date +%s) - start))); }
say() { echo "[$(($(date +%s) - start)) s] $*" | tee -a "$out/log.txt"; }

if [ ! -x "$venv/bin/mimicbench" ]; then
    python3 -m venv --system-site-packages "$venv"
    "$venv/bin/pip" install --quiet ${wheels:+--no-index --find-links "$wheels"} -e '.[gpu,dev]' 2>&1 | tee -a "$out/log.txt"
fi
bin=$venv/bin
say "$("$bin/python" -c 'import torch; print(torch.__version__, torch.cuda.is_available() and torch.cuda.get_device_name())')"

say "the backend beside the CPU"
MIMICBENCH_WARP=1 timeout "$(left)" "$bin/python" -m pytest -q tests/test_warp.py tests/test_devices.py > "$out/backend.txt" 2>&1
say "$(tail -n 1 "$out/backend.txt")"

say "the whole loop"
timeout "$(left)" "$bin/mimicbench" bench --device "$device" --num-envs 16384 > "$out/bench.txt" 2>&1
tail -n 20 "$out/bench.txt" | tee -a "$out/log.txt"

keep() { # of every training its newest checkpoint and its log, in two levels of folders
    find "$workdir" -path '*/track/*/checkpoint/model.safetensors' -o -path '*/imitate/*/policy/model.safetensors' | while read -r model; do
        folder=$(dirname "$model") stage=$(dirname "$(dirname "$model")")
        there=$out/$(basename "$stage")
        mkdir -p "$there"
        cp "$folder"/config.json "$model" "$there/"
        cp "$stage"/metrics.jsonl "$stage"/training.safetensors "$there/" 2>/dev/null
    done
}
while [ "$(left)" -gt 60 ]; do sleep 120; keep; done &
keeper=$!

while read -r command; do
    [ -z "$command" ] || [ "${command#\#}" != "$command" ] && continue
    [ "$(left)" -gt 30 ] || break
    say "mimicbench $command"
    # shellcheck disable=SC2086  # the line is several words
    timeout --signal=INT "$(($(left) - 20))" "$bin/mimicbench" $command --workdir "$workdir" --device "$device" 2>&1 | tail -n 40 | tee -a "$out/log.txt"
done < scripts/gpu-queue.txt
kill "$keeper" 2>/dev/null
keep
say "over"
