# Serves an instance for a check, to be sourced: `$program` in a folder of its own, `$work`, with its log
# in `$work/log`, until the script ends. Sets `$address`. Needs `$root` and a function `fail`. Before that
# it installs what checks, `$package` of PyPI in its `$version` and what the list `$besides` names, into
# `$tools`, a folder under target/; where that is set. A second server of the check is ended too, `$besides_server`.
# With `$scopes` the service has one key, `$key`, with these scopes.
[ -x "$program" ] || fail "$program is missing; make build, or set MESHWAY"
if [ -n "${package:-}" ]; then
  tools=$root/target/$package-$version
  if [ ! -x "$tools/bin/$package" ]; then
    python3 -m venv "$tools" || fail "no Python environment (Debian: apt-get install python3-venv)"
    "$tools/bin/pip" install --quiet --disable-pip-version-check "$package==$version" ${besides[@]+"${besides[@]}"}
  fi
fi

work=$(mktemp -d)
server=
besides_server=
tidy() {
  for process in $server $besides_server; do
    kill "$process" 2>/dev/null || true
    wait "$process" 2>/dev/null || true
  done
  rm -rf "$work"
}
trap tidy EXIT
keys=()
if [ -n "${scopes:-}" ]; then
  made=$("$program" key new --name check --scopes "$scopes")
  key=${made%%$'\n'*}
  sed 1,2d <<<"$made" > "$work/keys.toml"
  keys=(--config "$work/keys.toml")
fi
# A small reserve and short waits: the machine of the check is not the service's.
"$program" serve --listen 127.0.0.1:0 --data-dir "$work/data" --disk-reserve-mib 1 \
  --disk-reserve-percent 0 --max-streams 50 ${keys[@]+"${keys[@]}"} > "$work/log" 2>&1 &
server=$!
for _ in $(seq 100); do
  address=$(grep -o 'http://127[.]0[.]0[.]1:[0-9]*' "$work/log" | head -1 || true)
  [ -n "$address" ] && break
  kill -0 "$server" 2>/dev/null || { cat "$work/log" >&2; fail "the service did not start"; }
  sleep 0.1
done
[ -n "$address" ] || fail "the service did not say where it listens"
