import { describe, expect, it } from 'vitest';
import { parseMetrics, total } from './metrics';

const TEXT = `# HELP fleetcal_up_seconds Time since the start
# TYPE fleetcal_up_seconds gauge
fleetcal_up_seconds 58.4
fleetcal_robot_received_total{robot="tugger_01"} 6340
fleetcal_robot_received_total{robot="a\\"b",stream="wheel_odometry"} 2
nonsense
# EOF
`;

describe('metrics', () => {
  it('are read with their labels', () => {
    const samples = parseMetrics(TEXT);
    expect(samples).toHaveLength(3);
    expect(samples[2]?.labels).toEqual({ robot: 'a"b', stream: 'wheel_odometry' });
  });

  it('are summed over their labels', () => {
    const samples = parseMetrics(TEXT);
    expect(total(samples, 'fleetcal_robot_received_total')).toBe(6342);
    expect(total(samples, 'no_such_thing')).toBeNull();
  });
});
