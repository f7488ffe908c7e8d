#!/usr/bin/env bash
# Brings compose.yaml up as an operator does: a token, the image by HTTP, a call, and what it made after a restart.
set -euo pipefail
cd "$(dirname "$0")"

if [ -e tokens ]; then
    echo "packaging/tokens is there already: move it away first, so that its tokens stay yours" >&2
    exit 1
fi
said=$(mktemp)

compose() { docker compose -f compose.yaml "$@"; }

clean_up() {
    status=$?
    [ "$status" = 0 ] || compose logs || true
    compose down --volumes || true
    rm -f tokens "$said"
}
trap clean_up EXIT

ask() {  # a tool and its arguments as a JSON object: the answer, or the body of the refusal and status 22
    local meta='"io.modelcontextprotocol/protocolVersion": "2026-07-28",
        "io.modelcontextprotocol/clientInfo": {"name": "try_image", "version": "1"},
        "io.modelcontextprotocol/clientCapabilities": {}'
    curl --silent --show-error --fail-with-body --max-time 60 "$address/mcp" \
        --header "Authorization: Bearer $token" \
        --header "Content-Type: application/json" \
        --header "Accept: application/json, text/event-stream" \
        --header "MCP-Protocol-Version: 2026-07-28" \
        --header "Mcp-Method: tools/call" \
        --header "Mcp-Name: $1" \
        --data "{\"jsonrpc\": \"2.0\", \"id\": 1, \"method\": \"tools/call\",
            \"params\": {\"name\": \"$1\", \"arguments\": $2, \"_meta\": {$meta}}}"
}

touch tokens
compose config --quiet
compose build
docker run --rm "$(compose config --images)" token ci > tokens 2> "$said"
chmod 644 tokens  # the user of the image has to read it; it holds the token's digest
token=$(sed -n 's/^.*Bearer //p' "$said")

echo "==> Up, until its health check holds"
compose up --detach --wait --wait-timeout 180
address=http://$(compose port plannerforge 8765)
curl --silent --show-error --fail "$address/ready" > /dev/null
refused=$(curl --silent --output /dev/null --write-out '%{http_code}' --data '{}' "$address/mcp")
if [ "$refused" != 401 ]; then
    echo "a request without a token is answered with $refused" >&2
    exit 1
fi

echo "==> A call with the token"
made=$(ask configure_planner '{"planner": "frenetix", "preset": "Safety", "weights": ["jerk=0.7"]}' |
    grep --only-matching --max-count=1 'cfg_[0-9a-f]*' | head -n 1)
echo "made $made"

echo "==> Down and up again: the volume keeps what was made"
compose down
compose up --detach --wait --wait-timeout 180
ask list_artifacts '{}' | grep --quiet "$made"
echo "$made is there"
