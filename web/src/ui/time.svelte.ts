/** The time now, for everything on the page that ages; moves once a second. */

class Now {
  /** The service's time as shown, ms since 1970. */
  ms = $state(Date.now());
  /** How far the service's clock is ahead of the reader's, so that ages come out right. */
  #skew_ms = 0;

  /** The service's time at this moment. */
  current(): number {
    return Date.now() + this.#skew_ms;
  }

  /** Takes a time that the service has just given. Small differences are the network's. */
  learn(service_ms: number): void {
    const skew_ms = service_ms - Date.now();
    this.#skew_ms = Math.abs(skew_ms) > 2_000 ? skew_ms : 0;
  }

  /** Lets the time pass; returns how to stop it. */
  run(): () => void {
    const timer = setInterval(() => {
      this.ms = this.current();
    }, 1000);
    return () => clearInterval(timer);
  }
}

export const now = new Now();
