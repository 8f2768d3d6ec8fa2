/** Whether the page is too narrow for a table, which then becomes cards. */

class Narrow {
  matches = $state(false);

  constructor(width_px: number) {
    const query = matchMedia(`(max-width: ${width_px}px)`);
    this.matches = query.matches;
    query.addEventListener('change', () => (this.matches = query.matches));
  }
}

/** For one of eight columns. */
export const narrow = new Narrow(1_120);

/** For the fleet's, which has ten. */
export const narrowForFleet = new Narrow(1_259);
