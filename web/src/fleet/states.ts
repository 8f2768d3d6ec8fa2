/** Words and shapes for the states of a parameter. */

import type { ParameterStatus } from '../api/types';
import type { Face } from '../ui/face';

export const STATUSES: Record<ParameterStatus, Omit<Face, 'meaning'>> = {
  converged: { word: 'converged', shape: 'check', tone: 'good' },
  learning: { word: 'learning', shape: 'half', tone: 'active' },
  unobservable: { word: 'unobservable', shape: 'ring', tone: 'quiet' },
  fixed: { word: 'fixed', shape: 'dash', tone: 'quiet' },
  off: { word: 'off', shape: 'dash', tone: 'quiet' },
};
