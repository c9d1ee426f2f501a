# Sourced with packages as arguments: a temporary folder with an environment of them, removed at the end.
set -euo pipefail
echo "packages:  $*"
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check "$@"
PATH="$folder/venv/bin:$PATH"
cd "$folder"
