/** The real `fleetcal demo`, started for a test and ended after it. */

import { type ChildProcess, spawn } from 'node:child_process';
import { once } from 'node:events';
import { mkdtemp, rm } from 'node:fs/promises';
import { createServer } from 'node:net';
import { tmpdir } from 'node:os';
import { join } from 'node:path';

const READY_WITHIN_MS = 30_000;
const STOPPED_WITHIN_MS = 10_000;
const LOG_LINES_MAX = 60;

/** A port that is free now. */
async function freePort(): Promise<number> {
  const server = createServer().listen(0, '127.0.0.1');
  await once(server, 'listening');
  const address = server.address();
  server.close();
  await once(server, 'close');
  if (address === null || typeof address === 'string') throw new Error('no port is free');
  return address.port;
}

/** A running demo on ports and in a folder of its own. */
export class Demo {
  readonly url: string;
  readonly zenoh: string;
  #binary: string;
  #folder: string;
  #process: ChildProcess | undefined;
  #log: string[] = [];

  private constructor(binary: string, folder: string, http: number, zenoh: number) {
    this.#binary = binary;
    this.#folder = folder;
    this.url = `http://127.0.0.1:${http}`;
    this.zenoh = `tcp/127.0.0.1:${zenoh}`;
  }

  /** Starts a demo with an empty folder, and waits until it is ready. */
  static async start(): Promise<Demo> {
    const binary = process.env.FLEETCAL_BIN;
    if (!binary) throw new Error('FLEETCAL_BIN must name the fleetcal binary to be tested');
    const folder = await mkdtemp(join(tmpdir(), 'fleetcal-e2e-'));
    const demo = new Demo(binary, folder, await freePort(), await freePort());
    await demo.run();
    return demo;
  }

  /** Starts the process; again after {@link kill}. */
  async run(): Promise<void> {
    const http = this.url.replace('http://', '');
    const flags = ['--http', http, '--listen', this.zenoh, '--data', this.#folder];
    const child = spawn(this.#binary, ['demo', ...flags], { stdio: ['ignore', 'pipe', 'pipe'] });
    this.#process = child;
    const keep = (chunk: Buffer) => {
      this.#log.push(...chunk.toString().split('\n').filter(Boolean));
      this.#log.splice(0, Math.max(0, this.#log.length - LOG_LINES_MAX));
    };
    child.stdout?.on('data', keep);
    child.stderr?.on('data', keep);
    const until = Date.now() + READY_WITHIN_MS;
    while (!(await this.#ready())) {
      if (child.exitCode !== null || child.signalCode !== null || Date.now() > until) {
        throw new Error(`fleetcal demo did not become ready:\n${this.#log.join('\n')}`);
      }
      await new Promise((resolve) => setTimeout(resolve, 100));
    }
  }

  async #ready(): Promise<boolean> {
    try {
      return (await fetch(`${this.url}/readyz`)).ok;
    } catch {
      return false;
    }
  }

  /** Kills the process as a power cut would. */
  async kill(): Promise<void> {
    await this.#end('SIGKILL');
  }

  /** Ends the process as an operator would, and removes its folder. */
  async stop(): Promise<void> {
    await this.#end('SIGTERM');
    await rm(this.#folder, { recursive: true, force: true });
  }

  async #end(signal: NodeJS.Signals): Promise<void> {
    const child = this.#process;
    this.#process = undefined;
    if (!child || child.exitCode !== null || child.signalCode !== null) return;
    const exit = once(child, 'exit');
    child.kill(signal);
    const late = setTimeout(() => child.kill('SIGKILL'), STOPPED_WITHIN_MS);
    await exit;
    clearTimeout(late);
  }
}
