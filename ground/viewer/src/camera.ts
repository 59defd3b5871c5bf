// Where the viewer looks from: flying in the tunnel, hovering over the flat wall, and anything between while it unrolls.

import * as THREE from "three";
import type { Hit, Section } from "./section";
import type { Place } from "./scene";

export const FOV_DEG = 60;
/** The eye keeps this distance from the wall. */
const CLEARANCE_M = 0.06;
/** How far one may leave the panorama's ends. */
const BEYOND_M = 1.5;
const UNROLL_MS = 1400;
const GLIDE_MS = 500;

/** Over the flat wall the tunnel runs to the right, its left side is up: seen from inside, as in the panorama. */
const FLAT = new THREE.Quaternion().setFromRotationMatrix(
  new THREE.Matrix4().makeBasis(new THREE.Vector3(0, 0, -1), new THREE.Vector3(-1, 0, 0), new THREE.Vector3(0, 1, 0)),
);

interface Pose {
  position: THREE.Vector3;
  yaw: number;
  pitch: number;
}

/** A change over time, from 0 to 1. */
interface Glide {
  began_ms: number;
  lasts_ms: number;
  step: (share: number) => void;
}

const smooth = (share: number) => share * share * (3 - 2 * share);

export class Eye {
  readonly camera = new THREE.PerspectiveCamera(FOV_DEG, 1, 0.01, 2000);
  readonly fly: Pose = { position: new THREE.Vector3(), yaw: 0, pitch: 0 };
  /** Centre over the flat wall and height above it. */
  readonly hover = { x: 0, z: 0, height: 10 };
  /** 0 tunnel, 1 flat; the section follows. */
  share = 0;
  /** Share of the screen's width, on the right, that a panel covers. */
  covered = 0;
  onUnroll: () => void = () => {};
  private glide: Glide | null = null;
  private readonly flatY: number;
  private readonly flatRange: [number, number];

  constructor(private readonly section: Section, private readonly x_range_m: [number, number]) {
    section.unroll(1);
    const ends = [section.points[0]!, section.points[2 * section.count - 2]!];
    this.flatY = section.points[1]!;
    this.flatRange = [Math.min(...ends), Math.max(...ends)];
    section.unroll(0);
    this.home();
  }

  get flat(): boolean {
    return this.share > 0.5;
  }

  /** The first view: near the start, forward. */
  home(): void {
    const [from, to] = this.x_range_m;
    this.fly.position.set(0, 0, -(from + Math.min(1, (to - from) * 0.15)));
    this.fly.yaw = 0.35;
    this.fly.pitch = -0.12;
    this.overview();
  }

  /** All the way around on the screen, as far along as fits. */
  private overview(): void {
    const [low, high] = this.flatRange;
    const length_m = this.x_range_m[1] - this.x_range_m[0];
    const half = Math.tan((FOV_DEG * Math.PI) / 360);
    const seen_m = (high - low) * 1.25;
    const wide_m = seen_m * this.camera.aspect;
    this.hover.height = seen_m / 2 / half;
    this.hover.x = (low + high) / 2;
    const middle = -(this.x_range_m[0] + this.x_range_m[1]) / 2;
    const fits = wide_m * (1 - this.covered) > length_m;
    this.hover.z = (fits ? middle : this.fly.position.z) - (this.covered * wide_m) / 2;
  }

  /** Puts the camera where the state says. */
  apply(): void {
    const { camera, fly, hover } = this;
    const looking = new THREE.Quaternion().setFromEuler(new THREE.Euler(fly.pitch, -fly.yaw, 0, "YXZ"));
    const share = smooth(this.share);
    camera.position.lerpVectors(fly.position, new THREE.Vector3(hover.x, this.flatY + hover.height, hover.z), share);
    camera.quaternion.slerpQuaternions(looking, FLAT, share);
    camera.far = Math.max(200, 4 * hover.height + (this.x_range_m[1] - this.x_range_m[0]));
    camera.near = 0.005 + 0.02 * share;
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld();
  }

  /** Unrolls to a share at once. */
  setShare(share: number): void {
    const before = this.share;
    this.share = Math.min(Math.max(share, 0), 1);
    if (before === 0 && this.share > 0) this.overview();
    if (before === 1 && this.share < 1) this.follow();
    this.section.unroll(smooth(this.share));
    this.apply();
    this.onUnroll();
  }

  /** Unrolls, or rolls up, over a moment. */
  toggle(now_ms: number): void {
    const [from, to] = [this.share, this.share > 0.5 ? 0 : 1];
    this.start(now_ms, UNROLL_MS * Math.abs(to - from), (share) => this.setShare(from + (to - from) * share));
  }

  /** The flying eye goes to where the hovering one is. */
  private follow(): void {
    const place = this.section.hit([this.hover.x, this.flatY + this.hover.height, this.hover.z], [0, -1, 0]);
    if (place) this.lookAt(place);
  }

  /** Flying pose on the axis that looks at a place of the rolled-up wall. */
  private poseFor(place: Place): Pose {
    const unrolled = this.section.unrolled;
    this.section.unroll(0);
    const [x, y] = this.section.point(this.section.wrap(place.s_m));
    this.section.unroll(unrolled);
    // A little behind, so that the tunnel's direction can be seen; straight up and down have no yaw.
    const back_m = 0.35 * Math.hypot(x, y);
    const position = new THREE.Vector3(0, 0, this.clampZ(-place.x_m + back_m));
    return { position, yaw: Math.atan2(x, back_m), pitch: Math.atan2(y, Math.hypot(x, back_m)) };
  }

  private lookAt(place: Place): void {
    const pose = this.poseFor(place);
    this.fly.position.copy(pose.position);
    this.fly.yaw = pose.yaw;
    this.fly.pitch = pose.pitch;
  }

  /** Glides to a place. `closer`: over the flat wall, to half the height. */
  goTo(place: Place, now_ms: number, closer = false): void {
    if (this.flat) {
      const { x, z, height } = this.hover;
      const [to] = this.section.point(this.section.wrap(place.s_m));
      const lower = closer ? height / 2 : height;
      this.start(now_ms, GLIDE_MS, (share) => {
        this.hover.x = x + (to - x) * share;
        this.hover.z = z + (this.clampZ(-place.x_m) - z) * share;
        this.hover.height = height + (lower - height) * share;
        this.apply();
      });
      return;
    }
    const to = this.poseFor(place);
    const from = { position: this.fly.position.clone(), yaw: this.fly.yaw, pitch: this.fly.pitch };
    const turn = to.yaw - from.yaw;
    const shortest = turn - 2 * Math.PI * Math.round(turn / (2 * Math.PI));
    this.start(now_ms, GLIDE_MS, (share) => {
      this.fly.position.lerpVectors(from.position, to.position, share);
      this.fly.yaw = from.yaw + shortest * share;
      this.fly.pitch = from.pitch + (to.pitch - from.pitch) * share;
      this.apply();
    });
  }

  private start(began_ms: number, lasts_ms: number, step: (share: number) => void): void {
    this.glide = { began_ms, lasts_ms: Math.max(lasts_ms, 1), step };
  }

  /** Whether it moves by itself; call it every frame. */
  move(now_ms: number): boolean {
    if (!this.glide) return false;
    const share = Math.min(Math.max((now_ms - this.glide.began_ms) / this.glide.lasts_ms, 0), 1);
    const glide = this.glide;
    if (share === 1) this.glide = null;
    glide.step(smooth(share));
    return true;
  }

  stop(): void {
    this.glide = null;
  }

  ray(x: number, y: number, width: number, height: number): THREE.Ray {
    const at = new THREE.Vector3((x / width) * 2 - 1, 1 - (y / height) * 2, 0.5).unproject(this.camera);
    return new THREE.Ray(this.camera.position.clone(), at.sub(this.camera.position).normalize());
  }

  /** The wall under a point of the screen. */
  pick(x: number, y: number, width: number, height: number): Hit | null {
    const { origin, direction } = this.ray(x, y, width, height);
    return this.section.hit(origin.toArray(), direction.toArray());
  }

  /** Drag by pixels: the wall follows the pointer. */
  drag(dx: number, dy: number, height: number): void {
    const rad_per_px = ((FOV_DEG * Math.PI) / 180 / height) * 1.1;
    if (this.flat) {
      const m_per_px = (2 * this.hover.height * Math.tan((FOV_DEG * Math.PI) / 360)) / height;
      this.hover.z = this.clampZ(this.hover.z + dx * m_per_px);
      this.hover.x = this.clampFlat(this.hover.x - dy * m_per_px);
    } else {
      this.turn(-dx * rad_per_px, dy * rad_per_px);
    }
    this.apply();
  }

  turn(yaw: number, pitch: number): void {
    this.fly.yaw += yaw;
    this.fly.pitch = Math.min(Math.max(this.fly.pitch + pitch, -1.55), 1.55);
  }

  /** Towards what is under a point of the screen by a share of the way; negative: away from it. */
  zoom(share: number, x: number, y: number, width: number, height: number): void {
    if (this.flat) {
      const at = this.pick(x, y, width, height);
      const before = this.hover.height;
      this.hover.height = Math.min(Math.max(before * (1 - share), 0.05), 2000);
      if (at) {
        const [flatX] = this.section.point(at.s_m);
        const kept = this.hover.height / before;
        this.hover.x = this.clampFlat(flatX + (this.hover.x - flatX) * kept);
        this.hover.z = this.clampZ(-at.x_m + (this.hover.z + at.x_m) * kept);
      }
    } else {
      const { direction } = this.ray(x, y, width, height);
      const distance = this.pick(x, y, width, height)?.distance ?? 1;
      // Away from the wall at the pace at which one came; along the tunnel not by leaps.
      this.step(direction.multiplyScalar(Math.sign(share) * Math.min(Math.abs(share) * distance, 0.8)));
    }
    this.apply();
  }

  /** Moves along the view's own axes (right, up, forward), metres; over the flat wall right and up on the screen. */
  walk(right: number, up: number, forward: number): void {
    if (this.flat) {
      this.hover.z = this.clampZ(this.hover.z - right);
      this.hover.x = this.clampFlat(this.hover.x - up - forward);
    } else {
      // Forward is along the tunnel, the way that one faces it.
      const way = Math.cos(this.fly.yaw) >= 0 ? -1 : 1;
      const sideways = new THREE.Vector3(Math.cos(this.fly.yaw), 0, Math.sin(this.fly.yaw)).multiplyScalar(right);
      this.step(new THREE.Vector3(0, up, way * forward).add(sideways));
    }
    this.apply();
  }

  private step(by: THREE.Vector3): void {
    const { position } = this.fly;
    position.z = this.clampZ(position.z + by.z);
    const free = (x: number, y: number) =>
      [[1, 0], [-1, 0], [0, 1], [0, -1]].every(([a, b]) => this.section.contains(x + a! * CLEARANCE_M, y + b! * CLEARANCE_M));
    // Along the wall where the way through it is barred.
    if (free(position.x + by.x, position.y + by.y)) position.set(position.x + by.x, position.y + by.y, position.z);
    else if (free(position.x + by.x, position.y)) position.x += by.x;
    else if (free(position.x, position.y + by.y)) position.y += by.y;
  }

  private clampZ(z: number): number {
    return Math.min(Math.max(z, -this.x_range_m[1] - BEYOND_M), -this.x_range_m[0] + BEYOND_M);
  }

  private clampFlat(x: number): number {
    return Math.min(Math.max(x, this.flatRange[0]), this.flatRange[1]);
  }
}
