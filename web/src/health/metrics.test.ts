import { describe, expect, it } from 'vitest';
import { parseMetrics, total } from './metrics';

const TEXT = `# HELP process_start_time_seconds When the process started
# TYPE process_start_time_seconds gauge
process_start_time_seconds 58.4
fleetcal_robot_messages_total{robot="tugger_01",outcome="processed"} 6340
fleetcal_robot_messages_total{robot="a\\"b",outcome="dropped_scan"} 2
fleetcal_http_request_duration_seconds_bucket{le="+Inf",route="/api/v1/robots/{id}"} 3
nonsense
# EOF
`;

describe('metrics', () => {
  it('are read with their labels', () => {
    const samples = parseMetrics(TEXT);
    expect(samples).toHaveLength(4);
    expect(samples[2]?.labels).toEqual({ robot: 'a"b', outcome: 'dropped_scan' });
    expect(samples[3]?.labels.route).toBe('/api/v1/robots/{id}');
  });

  it('are summed over their labels', () => {
    const samples = parseMetrics(TEXT);
    const name = 'fleetcal_robot_messages_total';
    expect(total(samples, name)).toBe(6342);
    expect(total(samples, name, { outcome: 'dropped_scan' })).toBe(2);
    expect(total(samples, name, { outcome: 'refused' })).toBeNull();
    expect(total(samples, 'no_such_thing')).toBeNull();
  });
});
