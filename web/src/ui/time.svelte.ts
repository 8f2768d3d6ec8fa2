/** Current time for all ages on the page; updated once a second. */

class Now {
  /** The service's time as displayed, ms since 1970. */
  ms = $state(Date.now());
  /** Offset of the service's clock ahead of the reader's, so that ages are right. */
  #skew_ms = 0;

  /** Returns the service's time at this moment. */
  current(): number {
    return Date.now() + this.#skew_ms;
  }

  /**
   * Adjusts the offset to a time just received from the service. Small differences are the
   * network's.
   */
  learn(service_ms: number): void {
    const skew_ms = service_ms - Date.now();
    this.#skew_ms = Math.abs(skew_ms) > 2_000 ? skew_ms : 0;
  }

  /** Starts the updates; returns a function that stops them. */
  run(): () => void {
    const timer = setInterval(() => {
      this.ms = this.current();
    }, 1000);
    return () => clearInterval(timer);
  }
}

export const now = new Now();
