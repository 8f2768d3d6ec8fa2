/** Whether the page is as narrow as a phone: a table of ten columns then becomes cards. */

const NARROW = '(max-width: 900px)';

class Viewport {
  narrow = $state(false);

  constructor() {
    const query = matchMedia(NARROW);
    this.narrow = query.matches;
    query.addEventListener('change', () => (this.narrow = query.matches));
  }
}

export const viewport = new Viewport();
