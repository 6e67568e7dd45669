#!/usr/bin/env bash
# From a fresh clone to the verdict on a payload of one's own, with the time of each stage.
#     examples/first_verdict/walk.sh [--ready] [OUTPUT [DURATION]]
# --ready: the virtual environment and the FMUs are there already.  Default: results/first_verdict, 60 s.
# Ends with 0 where all requirements are met, with 1 where one is not or a stage failed.
set -euo pipefail
cd "$(dirname "$0")/../.."
here=examples/first_verdict
ready=
if [ "${1:-}" = --ready ]; then ready=1; shift; fi
output=${1:-results/first_verdict}
duration=${2:-60}
times=()

stage() {  # NAME COMMAND...: runs it, and notes how long it took
    local name=$1 start=$SECONDS code=0
    shift
    printf '\n== %s\n$ %s\n' "$name" "$*"
    "$@" || code=$?
    times+=("$(printf '%6d s  %s' $((SECONDS - start)) "$name")")
    return $code
}

mkdir -p "$output"
[ -n "$ready" ] || stage "set-up: virtual environment and FMUs" make fmus
stage "my payload as start values of the FMUs" \
    .venv/bin/ps-fmu parameters "$here/my_payload.toml" --output "$output/my_payload.ssv"
verdict=0
stage "runs without and with the isolator, and the verdict" \
    .venv/bin/python system/run.py isolation --duration "$duration" --parameters "$output/my_payload.ssv" \
    --requirements "$here/my_requirements.toml" --output "$output/run" || verdict=$?
# A run that failed before it began leaves the report of an earlier one, which is older than the start values.
[ "$output/run/report.html" -nt "$output/my_payload.ssv" ] ||
    { echo "There is no report: the run has failed." >&2; exit 1; }

printf '\n== Times\n'
printf '%s\n' "${times[@]}"
printf '%6d s  all\n' "$SECONDS"
[ "$verdict" = 0 ] && word="all met" || word="not all met"
echo "Requirements: $word. Open $output/run/report.html in a browser."
exit "$verdict"
