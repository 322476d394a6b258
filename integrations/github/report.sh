#!/usr/bin/env bash
# The step of action.yml: reports on FILES (one per line), with an annotation for each shape that meets FAIL_ON.
set -uo pipefail
mapfile -t files <<<"$FILES"
options=(--fail-on "$FAIL_ON" --table)
[ -z "$HTML" ] || options+=(--html "$HTML")
while IFS= read -r word; do
    [ -z "$word" ] || options+=("$word")
done <<<"$OPTIONS"
said="$(mktemp)"
table="$(topokit report "${files[@]}" "${options[@]}" 2>"$said")"
code=$?
cat "$said" >&2
printf '%s\n' "$table"
printf '```text\n%s\n```\n' "$table" >>"${GITHUB_STEP_SUMMARY:-/dev/null}"
# In a workflow command % and line ends are escaped, in its properties : and , as well.
sed -n 's/%/%25/g; s/^topokit: \(.*\) meets \(.*\)$/\1\t\2/p' "$said" | while IFS=$'\t' read -r file met; do
    file="${file//:/%3A}"
    echo "::error file=${file//,/%2C},title=topokit::meets $met"
done
rm -f "$said"
exit "$code"
