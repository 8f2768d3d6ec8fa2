import { describe, expect, it } from 'vitest';
import type { Detection } from '../api/types';
import { detectionText, isWatchingAll } from './detection';

const all = (state: Detection['steering']): Detection => ({
  steering: state,
  lidar_mount: state,
  vehicle: state,
});

describe('change detection', () => {
  it('is one word while every change would be detected', () => {
    expect(detectionText(all('watching'))).toBe('yes');
    expect(isWatchingAll(all('watching'))).toBe(true);
  });

  it('says once what is the same for all causes', () => {
    expect(detectionText(all('motion'))).toBe('not yet, the robot has driven or turned too little');
    expect(isWatchingAll(all('motion'))).toBe(false);
  });

  it('names the causes that are not watched', () => {
    const some = { ...all('watching'), steering: 'accuracy' as const };
    expect(detectionText(some)).toBe(
      'steering: not yet, the estimate is not accurate enough; LiDAR mount, wheels: yes',
    );
    expect(isWatchingAll(some)).toBe(false);
  });
});
