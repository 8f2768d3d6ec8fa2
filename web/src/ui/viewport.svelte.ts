/** True if the page is too narrow for a table, which then becomes cards. */

class Narrow {
  matches = $state(false);

  constructor(width_px: number) {
    const query = matchMedia(`(max-width: ${width_px}px)`);
    this.matches = query.matches;
    query.addEventListener('change', () => (this.matches = query.matches));
  }
}

/** Width limit for the table of proposals, which has eleven columns. */
export const narrowForProposals = new Narrow(1_419);

/** Width limit for the fleet's table, which has six columns. */
export const narrowForFleet = new Narrow(899);
