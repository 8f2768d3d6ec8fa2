#!/bin/sh
# What a maintenance tool asks of fleetcal over REST, with curl alone.
#
#   FLEETCAL_URL=http://127.0.0.1:8080 FLEETCAL_TOKEN=cal_... examples/rest/maintenance.sh ROBOT [NOTE]
#
# The token needs the role operator: fleetcal token create --data DIR --role operator --name maintenance
# It prints which robots have drifted and one robot's history of the last hour as CSV. Where a NOTE says
# what was done to the robot, it reports the reassembly, waits for the verdict while the robot drives, and
# proposes what was found if that has changed. Then it prints the audit.
set -eu

robot=${1:?name the robot}
note=${2:-}
url=${FLEETCAL_URL:-http://127.0.0.1:8080}
token=${FLEETCAL_TOKEN:?set FLEETCAL_TOKEN to an API token}
# How long to wait for a verdict, s: the robot has to drive some 40 m with turns both ways.
wait_s=${FLEETCAL_WAIT_S:-1800}

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

# The verdict on the report with the number $1: the first thing that the estimator has said after it.
verdict() {
    ask "$url/api/v1/robots/$robot/events?limit=100" | tr -d '\n' | sed 's/{"id":/\n{"id":/g' |
        sed -n "s/^{\"id\": *\([0-9]*\),.*\"kind\": *\"\(calibration_[a-z]*\)\".*/\1 \2/p" |
        awk -v after="$1" '$1 > after { kind = $2 } END { if (kind) print kind }'
}

if [ -n "$note" ]; then
    echo "== report: $robot was reassembled"
    report=$(ask --request POST "$url/api/v1/robots/$robot/events" \
        --header 'Content-Type: application/json' --header "$(once "note $robot $note")" \
        --data "{\"kind\": \"reassembled\", \"note\": $(quoted "$note")}")
    echo "$report"
    number=$(printf '%s' "$report" | sed 's/^{"id": *\([0-9]*\).*/\1/')

    # What was known before holds no more: nothing is proposed until the robot has shown what it is now.
    echo "== verdict: drive the robot; waiting for at most $wait_s s"
    until=$(($(date +%s) + wait_s))
    found=$(verdict "$number")
    while [ -z "$found" ] && [ "$(date +%s)" -lt "$until" ]; do
        sleep 5
        found=$(verdict "$number")
    done
    case $found in
    calibration_confirmed) echo "unchanged: the calibration of before still holds" ;;
    calibration_changed | calibration_learned)
        echo "$found: proposing what was found"
        # Right after a change it may take some metres more until the new values are known: 409.
        until ask --request POST "$url/api/v1/proposals" \
            --header 'Content-Type: application/json' \
            --header "$(once "proposal $robot $number")" \
            --data "{\"robot\": \"$robot\", \"reason\": $(quoted "$note")}"; do
            echo
            [ "$(date +%s)" -lt "$until" ] || break
            sleep 5
        done
        echo
        ;;
    *) echo "no verdict yet: run this again with the same NOTE, which reports nothing twice" ;;
    esac
fi

echo "== audit of $robot"
ask "$url/api/v1/audit?robot=$robot&format=csv&limit=20"
