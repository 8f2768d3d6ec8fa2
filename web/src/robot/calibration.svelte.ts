/** The records of one robot's calibration, as displayed on its page. */

import { Reading } from '../api/reading.svelte';
import type { CertificatePage, CrossTrackErrors, DeploymentPage, Shadow } from '../api/types';
import { fleet, robotUrl } from '../fleet/fleet.svelte';

const REREAD_EVERY_MS = 20_000;
const GATHER_MS = 250;
const DEPLOYMENTS_MAX = 100;

export class CalibrationRecords {
  readonly shadow: Reading<Shadow>;
  readonly deployments: Reading<DeploymentPage>;
  readonly crossTrack: Reading<CrossTrackErrors>;
  readonly certificates: Reading<CertificatePage>;
  #id: string;

  constructor(id: string) {
    this.#id = id;
    const path = robotUrl(id);
    this.shadow = new Reading(() => `${path}/shadow`);
    this.deployments = new Reading(() => `${path}/deployments?limit=${DEPLOYMENTS_MAX}`);
    const robot = new URLSearchParams({ robot: id, limit: String(DEPLOYMENTS_MAX) });
    this.certificates = new Reading(() => `/certificates?${robot}`);
    this.crossTrack = new Reading(() => `${path}/cross_track_error`);
  }

  /**
   * Reads the records, and again after each decision or event; returns a function that stops it.
   */
  run(): () => void {
    let gathering: ReturnType<typeof setTimeout> | undefined;
    const later = () => {
      clearTimeout(gathering);
      gathering = setTimeout(() => {
        void this.shadow.load();
        void this.deployments.load();
        void this.certificates.load();
      }, GATHER_MS);
    };
    const stops = [
      this.shadow.run(REREAD_EVERY_MS),
      this.deployments.run(REREAD_EVERY_MS),
      this.certificates.run(REREAD_EVERY_MS),
      this.crossTrack.run(REREAD_EVERY_MS),
      fleet.listen({
        approval: (robot) => {
          if (robot === this.#id) later();
        },
        resync: later,
      }),
      () => clearTimeout(gathering),
    ];
    return () => stops.forEach((stop) => stop());
  }
}
