/** Waves as they are typed, and the plan that they make. */

import type { WavePlan } from '../api/types';

export const TAKES = { robots: 'Number', share: 'Share, %', q: 'Query', rest: 'The rest' } as const;
export type Take = keyof typeof TAKES;

/** Wave as it is typed; shares in percent. */
export interface DraftWave {
  take: Take;
  /** Number, share in percent or query; empty for the rest. */
  value: string;
  verified: string;
  failed: string;
}

/** Waves that a new roll-out begins with: two robots, a fifth, and the rest. */
export function firstWaves(): DraftWave[] {
  return [
    { take: 'robots', value: '2', verified: '100', failed: '0' },
    { take: 'share', value: '20', verified: '90', failed: '5' },
    { take: 'rest', value: '', verified: '90', failed: '5' },
  ];
}

/** Returns a number as people type it, with a comma too; NaN if it is none. */
function numberOf(text: string): number {
  const plain = text.trim().replace(',', '.');
  return plain === '' ? NaN : Number(plain);
}

/** Returns the plan of typed waves, or the first wave that is wrong and why. */
export function planOf(waves: readonly DraftWave[]): WavePlan[] | string {
  const plan: WavePlan[] = [];
  for (const [index, wave] of waves.entries()) {
    const name = `Wave ${index + 1}`;
    const [verified, failed] = [numberOf(wave.verified), numberOf(wave.failed)];
    if (!(verified > 0 && verified <= 100)) {
      return `${name}: verified must be more than 0 and at most 100 %`;
    }
    if (!(failed >= 0 && failed < 100)) {
      return `${name}: failed must be at least 0 and less than 100 %`;
    }
    const take = takeOf(wave);
    if (typeof take === 'string' && take !== 'rest') return `${name}: ${take}`;
    plan.push({
      take: take as WavePlan['take'],
      verified_share: verified / 100,
      failed_share: failed / 100,
    });
  }
  return plan;
}

/** Returns what a wave takes, or why it cannot. */
function takeOf({ take, value }: DraftWave): WavePlan['take'] | string {
  const number = numberOf(value);
  switch (take) {
    case 'rest':
      return 'rest';
    case 'q':
      return value.trim() === '' ? 'a query is missing' : { q: value.trim() };
    case 'robots':
      return Number.isInteger(number) && number > 0
        ? { robots: number }
        : 'the number of robots must be 1 or more';
    case 'share':
      return number > 0 && number <= 100
        ? { share: number / 100 }
        : 'the share must be more than 0 and at most 100 %';
  }
}
