// Virtual reality through WebXR, where the browser and a headset have it. Only from this machine or through HTTPS: WebXR needs a
// secure context, which a plain address of another machine is not.

import * as THREE from "three";
import { element, reason, tell } from "./dom";
import type { Eye } from "./camera";

const SPEED_MPS = 1.2;

export class Headset {
  readonly rig = new THREE.Group();
  onLeave: () => void = () => {};

  constructor(private readonly renderer: THREE.WebGLRenderer, private readonly eye: Eye) {
    this.rig.add(eye.camera);
    void this.offer();
  }

  get worn(): boolean {
    return this.renderer.xr.isPresenting;
  }

  private async offer(): Promise<void> {
    if (!(await navigator.xr?.isSessionSupported("immersive-vr").catch(() => false))) return;
    const button = element("vr-button", HTMLButtonElement);
    button.hidden = false;
    button.addEventListener("click", () => void this.toggle());
  }

  private async toggle(): Promise<void> {
    const { xr } = this.renderer;
    if (xr.isPresenting) return void (await xr.getSession()?.end());
    try {
      const session = await navigator.xr!.requestSession("immersive-vr");
      this.eye.setShare(0);
      xr.enabled = true;
      // Where one looks from now is where the head is; the headset adds its own motion.
      xr.setReferenceSpaceType("local");
      this.rig.position.copy(this.eye.fly.position);
      this.rig.rotation.set(0, -this.eye.fly.yaw, 0);
      session.addEventListener("end", () => this.leave());
      await xr.setSession(session);
    } catch (error) {
      tell("vr", `Virtual reality does not start: ${reason(error)}`, "note");
    }
  }

  private leave(): void {
    this.renderer.xr.enabled = false;
    this.eye.fly.position.copy(this.rig.position);
    this.rig.position.set(0, 0, 0);
    this.rig.rotation.set(0, 0, 0);
    this.eye.apply();
    this.onLeave();
  }

  /** The sticks: forward and sideways the way one looks, kept inside by the flying eye's own rules. */
  move(seconds: number): void {
    for (const source of this.renderer.xr.getSession()?.inputSources ?? []) {
      const axes = source.gamepad?.axes ?? [];
      const [right, back] = [axes[2] ?? 0, axes[3] ?? 0];
      if (Math.hypot(right, back) < 0.15) continue;
      const looking = this.renderer.xr.getCamera().getWorldDirection(new THREE.Vector3());
      this.eye.fly.position.copy(this.rig.position);
      this.eye.fly.yaw = Math.atan2(looking.x, -looking.z);
      this.eye.walk(right * SPEED_MPS * seconds, 0, -back * SPEED_MPS * seconds);
      this.rig.position.copy(this.eye.fly.position);
    }
  }
}
