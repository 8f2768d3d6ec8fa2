"""Uses a client that openapi-python-client generated, against a running service.

FLEETCAL_URL and FLEETCAL_TOKEN (of an administrator) say where; `fleetcal_client` is on the path.
The robot `tugger_01` has driven.
"""

import datetime
import math
import os

from fleetcal_client import AuthenticatedClient
from fleetcal_client.api.access import create_token, list_tokens, revoke_token
from fleetcal_client.api.approval import approve_proposal, get_proposal, post_proposal
from fleetcal_client.api.robots import (
    get_estimate,
    get_history,
    get_robot,
    list_robots,
    post_event,
    put_robot,
)
from fleetcal_client.api.service import healthz, readyz
from fleetcal_client.models import (
    ApprovalRequest,
    CalibrationValues,
    EstimateDocument,
    Event,
    EventKind,
    HistoryDocument,
    NewEvent,
    NewProposal,
    NewToken,
    ParameterName,
    ParameterStatus,
    Problem,
    Proposal,
    ProposalState,
    Readiness,
    RobotConfig,
    RobotDocument,
    RobotEventKind,
    RobotPage,
    RobotState,
    Role,
    Token,
    TokenState,
    VehicleModel,
)
from fleetcal_client.models.rear_wheel import RearWheel
from fleetcal_client.models.speed_measured_at_type_2 import SpeedMeasuredAtType2

client = AuthenticatedClient(
    base_url=os.environ["FLEETCAL_URL"],
    token=os.environ["FLEETCAL_TOKEN"],
    raise_on_unexpected_status=True,
)


def robots():
    """Lists, registers and reads robots."""
    page = list_robots.sync(client=client)
    assert isinstance(page, RobotPage)
    assert [robot.id for robot in page.items] == ["tugger_01"]
    assert isinstance(page.items[0].state, RobotState)
    assert isinstance(page.items[0].last_seen, datetime.datetime)

    config = RobotConfig(
        model=VehicleModel.TRICYCLE,
        wheelbase_m=1.55,
        speed_measured_at=SpeedMeasuredAtType2(rear_wheel=RearWheel(lateral_m=0.3)),
    )
    registered = put_robot.sync_detailed(
        "tugger_02", client=client, body=config, if_none_match="*"
    )
    assert registered.status_code == 201
    assert isinstance(registered.parsed, RobotDocument)
    assert registered.parsed.config.model is VehicleModel.TRICYCLE
    assert registered.parsed.config.speed_measured_at.rear_wheel.lateral_m == 0.3
    assert registered.parsed.state is RobotState.NO_DATA, registered.parsed.state
    again = put_robot.sync(
        "tugger_02", client=client, body=config, if_none_match="*"
    )
    assert isinstance(again, Problem)
    assert (again.status, again.code) == (412, "version_conflict")

    unknown = get_robot.sync("nobody", client=client)
    assert isinstance(unknown, Problem)
    assert (unknown.status, unknown.code) == (404, "robot_unknown")


def estimate():
    """Reads what is known of a robot, and how it went."""
    now = get_estimate.sync("tugger_01", client=client)
    assert isinstance(now, EstimateDocument)
    assert now.robot == "tugger_01" and now.counts.scans > 500
    assert now.distance_m > 10.0
    offset = now.parameters.steering_offset
    assert isinstance(offset.status, ParameterStatus)
    assert math.isfinite(offset.value) and abs(offset.value) < 0.2

    went = get_history.sync(
        "tugger_01", client=client, parameter="steering_offset,lidar_x", max_points=50
    )
    assert isinstance(went, HistoryDocument)
    names = [series.parameter for series in went.series]
    assert names == [ParameterName.STEERING_OFFSET, ParameterName.LIDAR_X]
    assert 2 <= len(went.time) <= 50
    assert all(isinstance(time, datetime.datetime) for time in went.time)
    assert went.time == sorted(went.time)

    event = post_event.sync(
        "tugger_01",
        client=client,
        body=NewEvent(kind=RobotEventKind.MAINTENANCE, note="bracket replaced"),
        idempotency_key="generated-client-event",
    )
    assert isinstance(event, Event)
    assert event.kind is EventKind.MAINTENANCE and event.author == "client"


def proposal():
    """Makes and reads a proposal, which its author cannot approve."""
    values = CalibrationValues(
        lidar_x_m=0.4, lidar_y_m=0.1, lidar_yaw_rad=0.05, steering_offset_rad=0.03
    )
    made = post_proposal.sync(
        client=client,
        body=NewProposal(robot="tugger_01", reason="measured", values=values),
        idempotency_key="generated-client-proposal",
    )
    assert isinstance(made, Proposal), made
    assert made.state is ProposalState.PROPOSED
    read = get_proposal.sync(made.id, client=client)
    assert isinstance(read, Proposal)
    assert read.revision.values.steering_offset_rad == 0.03
    assert read.expires > read.created
    own = approve_proposal.sync(
        made.id,
        client=client,
        body=ApprovalRequest(sha256=read.revision.sha256),
        if_match=f'"{read.version}"',
    )
    assert isinstance(own, Problem)
    assert (own.status, own.code) == (403, "second_person_needed")


def token():
    """Makes, lists and revokes a token."""
    made = create_token.sync(client=client, body=NewToken(name="wall", role=Role.VIEWER))
    assert isinstance(made, Token)
    assert made.role is Role.VIEWER and made.value.startswith("cal_")
    viewer = AuthenticatedClient(base_url=client._base_url, token=made.value)
    refused = create_token.sync(
        client=viewer, body=NewToken(name="more", role=Role.ADMIN)
    )
    assert isinstance(refused, Problem)
    assert (refused.status, refused.code) == (403, "not_permitted")
    assert revoke_token.sync_detailed(made.id, client=client).status_code == 204
    listed = {one.name: one for one in list_tokens.sync(client=client).items}
    assert listed["wall"].state is TokenState.REVOKED
    ended = list_robots.sync(client=viewer)
    assert isinstance(ended, Problem)
    assert (ended.status, ended.code) == (401, "token_revoked")


assert healthz.sync(client=client) == "ok\n"
ready = readyz.sync(client=client)
assert isinstance(ready, Readiness) and ready.ready
robots()
estimate()
proposal()
token()
print("all typed")
