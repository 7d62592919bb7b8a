# Runs a whole session: two VE hosts, two HRTCs and five simulated users, two of whom lift a crate together. Then audits
# the contacts and compares the session with its bounds. scripts/demo and tactus-demo source this file, after
# children.sh. They define
#
#   command      name of the demo in messages
#   programs     function that sets `bin`, the folder of the programs, and builds them if necessary; the options are
#                already checked

usage() {
  cat <<EOF
Usage: $command [--model FILE]... [--seconds N] [--json FILE] [--keep DIR] [--quick] [--secured]

Makes two models. Then runs two VE hosts, two HRTCs and five simulated users on this machine, and prints the session's
report and an audit of the contacts against the original models. If N is at least 14, two users at different HRTCs
together raise a crate of 0.8 kg by 10 cm and hold it for 2 s.

  --model FILE   touch this model; repeatable. One model replaces the generated organ, two or more replace both models
  --seconds N    duration of the touches (default 20)
  --json FILE    write the report as JSON into this file
  --keep DIR     leave models, logs, snapshots, report and keys in this folder; without it they are deleted at the end
  --quick        generate smaller models, for CI
  --secured      make keys, and encrypt all samples of the session with them

  $command
  $command --model bunny.obj --seconds 10 --keep out/bunny

The last table compares values of the session with their bounds.

Exit status: 0 no row of the table falls short, 1 a row falls short or the session ended early,
2 wrong input or failed build, 130 interrupted.
EOF
}

inputs=()
touching=20
json=''
keep=''
quick=no
secured=no
organ_faces=500000
terrain_faces=400000
while [[ $# -gt 0 ]]; do
  case $1 in
    --model) need_value "$@"; inputs+=("$2"); shift ;;
    --seconds) need_value "$@"; touching=$2; shift ;;
    --json) need_value "$@"; json=$2; shift ;;
    --keep) need_value "$@"; keep=$2; shift ;;
    --quick) quick=yes; organ_faces=60000; terrain_faces=40000 ;;
    --secured) secured=yes ;;
    -h | --help) usage; exit 0 ;;
    *) fail "unknown option '$1'; see $command --help" ;;
  esac
  shift
done
[[ $touching =~ ^[1-9][0-9]{0,3}$ ]] || fail "--seconds is '$touching'; expected a whole number from 1 to 9999"
for input in "${inputs[@]}"; do
  [[ -r $input && -f $input ]] || fail "model '$input' is not a readable file"
done
say "tactus demo"

# absolute PATH: the absolute path of a file. Its folder must exist, the file need not.
absolute() {
  local folder
  folder=$(cd "$(dirname "$1")" 2>/dev/null && pwd) || fail "no folder $(dirname "$1")"
  printf '%s/%s\n' "${folder%/}" "${1##*/}"
}
for i in "${!inputs[@]}"; do inputs[i]=$(absolute "${inputs[i]}"); done
if [[ -n $json ]]; then
  json=$(absolute "$json")
  : >"$json" || fail "cannot write '$json'"
fi
if [[ -n $keep ]]; then
  mkdir -p "$keep" || fail "cannot make folder '$keep'"
  work=$(cd "$keep" && pwd)
  [[ -w $work ]] || fail "cannot write into '$work'"
else
  work=$(mktemp -d -t tactus-demo.XXXXXX)
fi

at_exit() {
  stop_children
  [[ -n $keep ]] || rm -rf "$work"
}

programs
cd "$work"
built_at=$SECONDS

# ---- models ----

declare -A name_of
# launch NAME PROGRAM OPTION...: starts a program in the background, with its output in NAME.log.
launch() {
  local name=$1
  shift
  start "$@" >"$work/$name.log" 2>&1
  name_of[$child]=$name
}

# finish PID: waits for a program. If its exit status is an error, shows the end of its log and fails.
finish() {
  local status=0
  wait "$1" || status=$?
  ((status == 0)) && return
  tail -n 20 "$work/${name_of[$1]}.log" >&2
  fail "${name_of[$1]} ended with status $status"
}

# kind, faces, size of the longest side in metres
defaults=("organ $organ_faces 0.2" "terrain $terrain_faces 0.3")
declare -A sizes
originals=("${inputs[@]}")
pending=()
while [[ ${#originals[@]} -lt 2 ]]; do
  read -r kind faces size <<<"${defaults[${#originals[@]}]}"
  say "generating $kind, $faces faces"
  originals+=("$work/$kind.ply")
  sizes[$work/$kind.ply]=$size
  launch "generate-$kind" "$bin/tactus-mesh" generate "$kind" --faces "$faces" --seed 1 "$work/$kind.ply"
  pending+=("$child")
done
for pid in "${pending[@]}"; do finish "$pid"; done

models=()
pending=()
for original in "${originals[@]}"; do
  name=${original##*/}
  name=${name%.*}
  while [[ " ${models[*]} " == *" $work/$name.spm "* ]]; do name+=-again; done
  models+=("$work/$name.spm")
  say "building $name.spm"
  launch "build-$name" "$bin/tactus-mesh" build "$original" "$work/$name.spm" --size "${sizes[$original]:-0.2}"
  pending+=("$child")
done
for pid in "${pending[@]}"; do finish "$pid"; done

# The crate is 12 cm wide and stands on the ground, away from the models.
scenario=demo
crate=()
if ((touching >= 14)); then
  scenario=demo-lift
  run "$bin/tactus-mesh" generate box --faces 3000 "$work/crate.ply" >"$work/crate.log"
  run "$bin/tactus-mesh" build "$work/crate.ply" "$work/crate.spm" --size 0.12 >>"$work/crate.log"
  cat >"$work/crate.yaml" <<EOF
objects:
  - model: crate.spm
    position: [0, 0.6, 0.06]
    material: {stiffness: 1000, static_friction: 0.9, dynamic_friction: 0.8}
    body: {mass: 0.8, friction: 0.6}
ground: 0
EOF
  crate=(--config "$work/crate.yaml")
fi

# The additional bounds of this session (tactus-judge --help).
promise=()
if [[ $scenario == demo-lift ]]; then promise+=(--lift); fi
if [[ ${#inputs[@]} -eq 0 && $quick == no ]] && ((touching >= 20)); then promise+=(--eviction); fi
if [[ ${#inputs[@]} -eq 0 ]] && ((touching <= 20)); then
  [[ $quick == yes ]] && promise+=(--received-share 0.4) || promise+=(--received-share 0.2)
fi

# json_number FILE KEY: the first number called KEY.
json_number() {
  local text
  text=$(<"$1")
  [[ $text =~ \"$2\"[[:space:]]*:[[:space:]]*([0-9]+) ]] || fail "no \"$2\" in $1"
  printf '%s\n' "${BASH_REMATCH[1]}"
}

# The pool of each HRTC has room for the base meshes and for a 28th of all records, at least for six times the
# certificate of one tip. So regions have to be coarsened and refined again. The compressed cache has blocks for a 36th
# of all records, at least for four times that certificate. Users of the generated models touch more than this in 20 s,
# so regions are evicted and loaded again.
slots=0
parts=0
most=0
for model in "${models[@]}"; do
  "$bin/tactus-mesh" info "$model" --json >"$model.json"
  slots=$((slots + $(json_number "$model.json" base_vertices) + $(json_number "$model.json" base_faces)))
  parts=$((parts + $(json_number "$model.json" parts)))
  need=$(json_number "$model.json" slots)
  ((need > most)) && most=$need
done
slots=$((slots + (parts / 28 > 6 * most ? parts / 28 : 6 * most)))
blocks=$((parts / 36 > 4 * most ? parts / 36 : 4 * most))
if [[ $scenario == demo-lift ]]; then
  "$bin/tactus-mesh" info "$work/crate.spm" --json >"$work/crate.json"
  for part in base_vertices base_faces parts; do slots=$((slots + $(json_number "$work/crate.json" "$part"))); done
fi

# ---- session ----

# Prints the first of three consecutive domains in which no program of this machine participates: their discovery ports,
# 7400 + 250 * domain, are not bound.
free_domain() {
  local bound=' ' port domain try
  local -a fields
  while read -r -a fields; do
    [[ ${fields[1]:-} == *:* ]] || continue
    bound+="$((16#${fields[1]##*:})) "
  done < <(cat /proc/net/udp)
  for try in {1..50}; do
    domain=$((20 + RANDOM % 76))
    for port in 0 1 2; do
      [[ $bound == *" $((7400 + 250 * (domain + port))) "* ]] && continue 2
    done
    printf '%s\n' "$domain"
    return 0
  done
  fail "no free DDS domain between 20 and 97 after $try tries"
}
domain=$(free_domain)
session="demo-$$"
# join ROLE NAME [USER...]: sets `options`, with which the program NAME joins the session. With --secured makes its keys.
join() {
  options=(--session "$session" --domain "$domain" --name "$2")
  [[ $secured == yes ]] || return 0
  run "$bin/tactus-keys" "add-$1" "$work/keys-of-$session" "${@:2}" >>"$work/keys.log"
  options+=(--keys "$work/keys-of-$session/members/$2" --audit "$work/$2.audit.jsonl")
}
if [[ $secured == yes ]]; then
  run "$bin/tactus-keys" init "$work/keys-of-$session" >"$work/keys.log"
fi
say "session $session on domain $domain: ${#models[@]} models, pools of $slots slots, caches of $blocks blocks"

name_of=()
served_a=()
served_b=()
for i in "${!models[@]}"; do
  ((i % 2 == 0)) && served_a+=("${models[i]}") || served_b+=("${models[i]}")
done
hrtcs=(hrtc-1 hrtc-2)
join host host-a
launch host-a "$bin/tactus-host" "${options[@]}" "${crate[@]}" "${served_a[@]}"
join host host-b
launch host-b "$bin/tactus-host" "${options[@]}" "${served_b[@]}" --at 0.5 0 0
hrtc_pids=()
for name in "${hrtcs[@]}"; do
  join hrtc "$name"
  launch "$name" "$bin/tactus-hrtc" "${options[@]}" --pool "$slots" --compressed-cache "$blocks" \
    --log "$work/$name.hlog" --snapshot "$work/snapshots-$name" --reference-timer
  hrtc_pids+=("$child")
done
join operator sim ann bob cyn dan eve
launch sim "$bin/tactus-sim" "${options[@]}" --scenario "$scenario" --seconds "$touching" --json "$work/report.json"
sim=$child
say "touching for $touching s"

# tactus-sim ends the session, and then hosts and HRTCs end. A watchdog ends a session that hangs.
start sleep $((touching + 60))
watchdog=$child
ended=''
status=0
while [[ $ended != "$sim" && $ended != "$watchdog" && $status -eq 0 ]]; do
  wait -n -p ended || status=$?
done
kill "$watchdog" 2>/dev/null || true
if [[ $ended != "$sim" || $status -ne 0 ]]; then
  if [[ $ended == "$watchdog" ]]; then
    say "the session did not end within $((touching + 60)) s"
  else
    say "${name_of[$ended]} ended with status $status"
  fi
  for name in "${name_of[@]}"; do
    printf -- '---- end of %s.log\n' "$name" >&2
    tail -n 12 "$work/$name.log" >&2
  done
  exit 1
fi

for pid in "${hrtc_pids[@]}"; do kill -INT -- "-$pid" 2>/dev/null || true; done
ending_at=$((SECONDS + 5))
for pid in "${hrtc_pids[@]}"; do
  while kill -0 "$pid" 2>/dev/null; do
    ((SECONDS < ending_at)) || fail "${name_of[$pid]} did not end within 5 s of SIGINT"
    sleep 0.05
  done
  finish "$pid"
done

# ---- report ----

sed -n '/^Session /,$p' "$work/sim.log"  # without the lines before the session
[[ -z $json ]] || cp "$work/report.json" "$json"
audits=()
for name in "${hrtcs[@]}"; do
  for i in "${!models[@]}"; do
    printf '\n'
    audit="$work/audit-$name-$i.json"
    audited=0
    run "$bin/tactus-mesh" audit "$work/$name.hlog" "${originals[i]}" --spm "${models[i]}" --json "$audit" || audited=$?
    ((audited < 2)) || fail "the log of $name cannot be audited"
    audits+=("$audit")
  done
done
printf '\n'
failed=0
run "$bin/tactus-judge" "$work/report.json" "${audits[@]}" "${promise[@]}" || failed=$?
((failed != 1)) || printf '\nA row falls short. Other programs on this machine may be the reason: see the load in "uptime", and run %s.\n' \
  "'$bin/tactus doctor'"
[[ -z $keep ]] || printf '\nmodels, logs and report are in %s\n' "$work"
say "$((SECONDS - built_at)) s from models to report"
exit "$failed"
