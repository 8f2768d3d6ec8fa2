/** The real `fleetcal` binary, started for a test and ended after it. */

import { type ChildProcess, spawn } from 'node:child_process';
import { once } from 'node:events';
import { mkdtemp, rm } from 'node:fs/promises';
import { createServer } from 'node:net';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { fileURLToPath } from 'node:url';

const READY_WITHIN_MS = 30_000;
const STOPPED_WITHIN_MS = 10_000;
const LOG_LINES_MAX = 60;
/** Stamp that the first drive begins with, s since 1970, */
const FIRST_DRIVE_S = 1_760_000_000;
/** and how much later the next one does. */
const BETWEEN_DRIVES_S = 300;

/** The administrator of every service that a test starts, the demo's apart. */
export const ADMIN = { name: 'ada', password: 'correct horse battery' };

/** Ports of a service: its dashboard's and its robots'. */
interface Ports {
  http: number;
  zenoh: number;
}

/** State of a browser in which somebody has signed in. */
export interface SignedIn {
  cookies: {
    name: string;
    value: string;
    domain: string;
    path: string;
    expires: number;
    httpOnly: boolean;
    secure: boolean;
    sameSite: 'Strict';
  }[];
  origins: [];
}

/** Number of ports that this worker has asked for. */
let asked = 0;

/**
 * A free port below those that the system chooses for connections and for port 0, which it may choose
 * again at once. Workers start at ports that lie apart.
 */
async function freePort(): Promise<number> {
  for (;;) {
    const port = 10_000 + ((process.pid * 64 + asked++) % 10_000);
    const server = createServer().listen(port, '127.0.0.1');
    const isFree = await Promise.race([
      once(server, 'listening').then(() => true),
      new Promise<false>((resolve) => server.once('error', () => resolve(false))),
    ]);
    server.close();
    if (isFree) return port;
  }
}

/** The binary to be tested. */
export function binary(): string {
  const path = process.env.FLEETCAL_BIN;
  if (!path) throw new Error('FLEETCAL_BIN must name the fleetcal binary to be tested');
  return path;
}

/** Ends a process, and waits until it has. */
async function end(child: ChildProcess | undefined, signal: NodeJS.Signals): Promise<void> {
  if (!child || child.exitCode !== null || child.signalCode !== null) return;
  const exit = once(child, 'exit');
  child.kill(signal);
  const late = setTimeout(() => child.kill('SIGKILL'), STOPPED_WITHIN_MS);
  await exit;
  clearTimeout(late);
}

/** A running service on ports and in a folder of its own, with its robots (`demo`) or without. */
export class Service {
  readonly url: string;
  readonly zenoh: string;
  #command: 'demo' | 'serve';
  #flags: string[];
  #folder: string;
  #process: ChildProcess | undefined;
  #robots: ChildProcess | undefined;
  #drives = 0;
  #log: string[] = [];
  /** Its whole output for people. */
  #printed = '';
  #signedIn = new Map<string, Promise<SignedIn>>();

  private constructor(command: 'demo' | 'serve', rate: number, folder: string, ports: Ports) {
    const { http, zenoh } = ports;
    this.#command = command;
    this.#folder = folder;
    this.url = `http://127.0.0.1:${http}`;
    this.zenoh = `tcp/127.0.0.1:${zenoh}`;
    this.#flags = ['--http', `127.0.0.1:${http}`, '--listen', this.zenoh, '--data', folder];
    if (command === 'demo') this.#flags.push('--rate', String(rate));
  }

  /**
   * Starts the service with an empty folder, and waits until it is ready. For the robots of a demo
   * `rate` seconds pass in one of real time.
   */
  static async start(command: 'demo' | 'serve', rate: number): Promise<Service> {
    const folder = await mkdtemp(join(tmpdir(), 'fleetcal-e2e-'));
    const ports = { http: await freePort(), zenoh: await freePort() };
    const service = new Service(command, rate, folder, ports);
    await service.run();
    return service;
  }

  /** Starts the process; again after {@link kill}. */
  async run(): Promise<void> {
    const command = [this.#command, ...this.#flags];
    const child = spawn(binary(), command, { stdio: ['ignore', 'pipe', 'pipe'] });
    this.#process = child;
    const keep = (chunk: Buffer) => {
      this.#log.push(...chunk.toString().split('\n').filter(Boolean));
      this.#log.splice(0, Math.max(0, this.#log.length - LOG_LINES_MAX));
    };
    child.stdout?.on('data', keep);
    child.stdout?.on('data', (chunk: Buffer) => (this.#printed += chunk.toString()));
    child.stderr?.on('data', keep);
    const until = Date.now() + READY_WITHIN_MS;
    while (!(await this.#ready())) {
      if (child.exitCode !== null || child.signalCode !== null || Date.now() > until) {
        throw new Error(`fleetcal ${this.#command} did not become ready:\n${this.#log.join('\n')}`);
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

  /** Waits until the service has printed a line, and returns the text that the pattern captures. */
  async #told(pattern: RegExp): Promise<string> {
    const until = Date.now() + READY_WITHIN_MS;
    for (;;) {
      const found = pattern.exec(this.#printed)?.[1];
      if (found !== undefined) return found;
      if (Date.now() > until) throw new Error(`${pattern} was not printed:\n${this.#printed}`);
      await new Promise((resolve) => setTimeout(resolve, 50));
    }
  }

  /** The link by which the first administrator is made. */
  setupLink(): Promise<string> {
    return this.#told(/^set up at (\S+)$/m);
  }

  /** A browser's state in which `name` is signed in: of the demo one of its accounts. */
  signedIn(name: string): Promise<SignedIn> {
    const known = this.#signedIn.get(name) ?? this.#signIn(name);
    this.#signedIn.set(name, known);
    return known;
  }

  async #signIn(name: string): Promise<SignedIn> {
    if (this.#command === 'demo') {
      const password = await this.#told(new RegExp(`^  ${name} +(\\S+)$`, 'm'));
      return this.#begin('/api/v1/session', { name, password });
    }
    const code = new URL(await this.setupLink()).hash.replace('#code=', '');
    return this.#begin('/api/v1/setup', { code, ...ADMIN });
  }

  async #begin(path: string, body: object): Promise<SignedIn> {
    const response = await fetch(this.url + path, {
      method: 'POST',
      headers: { 'content-type': 'application/json' },
      body: JSON.stringify(body),
    });
    const [pair] = (response.headers.get('set-cookie') ?? '').split(';');
    const [name, value] = (pair ?? '').split('=');
    if (!response.ok || !name || !value) throw new Error(`signing in failed: ${response.status}`);
    const cookie = {
      name,
      value,
      domain: '127.0.0.1',
      path: '/',
      expires: -1,
      httpOnly: true,
      secure: false,
      sameSite: 'Strict' as const,
    };
    return { cookies: [cookie], origins: [] };
  }

  /** Starts simulated robots that drive and send to the service: with their LiDARs turned by so much. */
  simulate(robots = 1, turned_deg = 0): void {
    const flags = ['simulate', '--robots', String(robots), '--turn-lidar', String(turned_deg)];
    this.#robots = spawn(binary(), [...flags, '--connect', this.zenoh], { stdio: 'ignore' });
  }

  /**
   * Drives a recording of the simulated robot `tugger_01`, later than those before, as fast as the service works:
   * with its LiDAR turned by so much.
   */
  async drive(duration_s: number, turned_deg = 0): Promise<void> {
    const start_s = FIRST_DRIVE_S + this.#drives * BETWEEN_DRIVES_S;
    this.#drives += 1;
    const path = join(this.#folder, `drive-${start_s}.mcap`);
    const record = ['--record', path, '--start-stamp', String(start_s)];
    const robot = ['--duration', String(duration_s), '--turn-lidar', String(turned_deg)];
    await this.#execute(['simulate', ...record, ...robot]);
    const sent = ['replay', path, '--rate', 'max', '--robot', 'tugger_01'];
    await this.#execute([...sent, '--connect', this.zenoh]);
  }

  /** Runs a command of the binary to its end. */
  async #execute(command: string[]): Promise<void> {
    const ended = once(spawn(binary(), command, { stdio: 'ignore' }), 'exit');
    const [status] = (await ended) as [number | null];
    if (status !== 0) throw new Error(`fleetcal ${command.join(' ')}: ${status}`);
  }

  /** The same of a robot that speaks ROS 2 alone, by `rmw_zenoh`. */
  simulateRos2(id: string): void {
    const python = process.env.FLEETCAL_PYTHON;
    if (!python) throw new Error('FLEETCAL_PYTHON must name a Python with eclipse-zenoh');
    const script = fileURLToPath(new URL('ros_robot.py', import.meta.url));
    this.#robots = spawn(python, [script, this.zenoh, id, binary()], { stdio: 'ignore' });
  }

  /** Stops the robots. */
  async stopRobots(): Promise<void> {
    await end(this.#robots, 'SIGTERM');
  }

  /** Kills the service as a power cut would. */
  async kill(): Promise<void> {
    await end(this.#process, 'SIGKILL');
  }

  /** Ends everything as an operator would, and removes the folder. */
  async stop(): Promise<void> {
    await this.stopRobots();
    await end(this.#process, 'SIGTERM');
    await rm(this.#folder, { recursive: true, force: true });
  }
}
