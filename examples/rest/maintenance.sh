#!/bin/sh
# What a maintenance tool asks of fleetcal over REST, with curl alone.
#
#   FLEETCAL_URL=http://127.0.0.1:8080 FLEETCAL_TOKEN=cal_... examples/rest/maintenance.sh ROBOT [NOTE]
#
# The token needs the role operator: fleetcal token create --data DIR --role operator --name maintenance
# It prints which robots have drifted and one robot's history of the last hour as CSV, notes that
# the robot was reassembled where a NOTE says what was done, proposes its latest calibration where
# it is known, and prints the audit.
set -eu

robot=${1:?name the robot}
note=${2:-}
url=${FLEETCAL_URL:-http://127.0.0.1:8080}
token=${FLEETCAL_TOKEN:?set FLEETCAL_TOKEN to an API token}

# Asks, and fails with the problem document on anything but 2xx.
ask() {
    curl --silent --show-error --fail-with-body --max-time 20 \
        --header "Authorization: Bearer $token" "$@"
}

# The same key for the same request on the same day: neither a network that swallows the answer nor
# a second run makes it happen twice.
once() {
    printf 'Idempotency-Key: %s-%s' "$(printf '%s' "$1" | cksum | tr ' ' '-')" "$(date -u +%Y%m%d)"
}

# Text as a JSON string: quotes and backslashes escaped, line breaks as blanks.
quoted() {
    printf '"%s"' "$(printf '%s' "$1" | tr '\n\t' '  ' | sed 's/[\\"]/\\&/g')"
}

echo "== robots whose vehicle has changed since it was calibrated"
ask "$url/api/v1/robots?state=changed&sort=severity"
echo

echo "== history of $robot: the last hour, as CSV"
ask "$url/api/v1/robots/$robot/history?parameter=steering_offset,lidar_yaw&max_points=60&format=csv"

if [ -n "$note" ]; then
    echo "== note: $robot was reassembled"
    ask --request POST "$url/api/v1/robots/$robot/events" \
        --header 'Content-Type: application/json' --header "$(once "note $robot $note")" \
        --data "{\"kind\": \"reassembled\", \"note\": $(quoted "$note")}"
    echo
fi

echo "== proposal of what the estimator has found for $robot"
if ! ask --request POST "$url/api/v1/proposals" \
    --header 'Content-Type: application/json' --header "$(once "proposal $robot")" \
    --data "{\"robot\": \"$robot\", \"reason\": \"scheduled maintenance\"}"; then
    # 409: not known yet, or a deployment is under way. Both are answers, not failures.
    echo
    echo "(not now)"
fi
echo

echo "== audit of $robot"
ask "$url/api/v1/audit?robot=$robot&format=csv&limit=20"
