#!/bin/sh
# What a maintenance tool asks of fleetcal over REST, with curl alone.
#
#   FLEETCAL_URL=http://127.0.0.1:8080 FLEETCAL_TOKEN=cal_... examples/rest/maintenance.sh ROBOT
#
# The token needs the role operator: fleetcal token create --data DIR --role operator --name maintenance
# It prints which robots have drifted, one robot's history of the last hour as CSV, notes that the
# robot was reassembled, proposes its latest calibration where it is known, and prints the audit.
set -eu

robot=${1:?name the robot}
url=${FLEETCAL_URL:-http://127.0.0.1:8080}
token=${FLEETCAL_TOKEN:?set FLEETCAL_TOKEN to an API token}

# Asks, and fails with the problem document on anything but 2xx.
ask() {
    curl --silent --show-error --fail-with-body --max-time 20 \
        --header "Authorization: Bearer $token" "$@"
}

# The same key for each repetition of one request: a network that swallows the answer does not
# make it happen twice.
once() {
    printf 'Idempotency-Key: %s-%s-%s' "$1" "$robot" "$(date -u +%Y%m%dT%H%M%S)"
}

echo "== robots whose vehicle has changed since it was calibrated"
ask "$url/api/v1/robots?state=changed&sort=severity"
echo

echo "== history of $robot: the last hour, as CSV"
ask "$url/api/v1/robots/$robot/history?parameter=steering_offset,lidar_yaw&max_points=60&format=csv"

echo "== note: $robot was reassembled"
ask --request POST "$url/api/v1/robots/$robot/events" \
    --header 'Content-Type: application/json' --header "$(once note)" \
    --data '{"kind": "reassembled", "note": "LiDAR bracket replaced"}'
echo

echo "== proposal of what the estimator has found for $robot"
if ! ask --request POST "$url/api/v1/proposals" \
    --header 'Content-Type: application/json' --header "$(once proposal)" \
    --data "{\"robot\": \"$robot\", \"reason\": \"scheduled maintenance\"}"; then
    # 409: not known yet, or a deployment is under way. Both are answers, not failures.
    echo
    echo "(not now)"
fi
echo

echo "== audit of $robot"
ask "$url/api/v1/audit?robot=$robot&format=csv&limit=20"
