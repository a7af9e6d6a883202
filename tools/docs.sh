#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds the documents and the API reference into results/docs/html; ends non-zero when a link leads nowhere. It reads
# the sources and starts none of them, so neither ROS nor `make build` is needed.
set -euo pipefail
cd "$(dirname "$0")/.."
stamp=.venv-docs/.requirements
key=$(sha256sum <requirements-docs.txt)
if [ "$(cat $stamp 2>/dev/null)" != "$key" ]; then
  echo "docs: virtual environment .venv-docs"
  /usr/bin/python3 -m venv .venv-docs || { echo "docs: it needs the Debian package python3-venv" >&2; exit 1; }
  .venv-docs/bin/pip install -q --disable-pip-version-check -r requirements-docs.txt 2>.venv-docs/pip.log || {
    tail -n 5 .venv-docs/pip.log >&2
    echo "docs: pip could not install requirements-docs.txt (network?)" >&2
    exit 1
  }
  echo "$key" >$stamp
fi
python3 tools/docs_site.py results/docs
NO_MKDOCS_2_WARNING=1 .venv-docs/bin/mkdocs build --quiet --strict -f results/docs/mkdocs.yml
echo "docs: results/docs/html/index.html"
