/** Whether the page is too narrow for a table, which then becomes cards. */

class Narrow {
  matches = $state(false);

  constructor(width_px: number) {
    const query = matchMedia(`(max-width: ${width_px}px)`);
    this.matches = query.matches;
    query.addEventListener('change', () => (this.matches = query.matches));
  }
}

/** For that of proposals, which has eleven. */
export const narrowForProposals = new Narrow(1_419);

/** For the fleet's, which has six. */
export const narrowForFleet = new Narrow(899);
