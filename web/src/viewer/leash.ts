/** Keeps a camera where coded cameras are near and look in about its direction. */

import { Quaternion, type PerspectiveCamera, Vector3 } from "three";
import type { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import type { CameraPath } from "./camera-path";

export class Leash {
  /** Path through the coded cameras; without one, the camera may go anywhere. */
  path: CameraPath | null = null;
  private readonly position = new Vector3();
  private readonly quaternion = new Quaternion();
  private readonly target = new Vector3();

  constructor(private readonly camera: PerspectiveCamera) {}

  /** Keep the pose as the last allowed one. */
  allow(orbit: OrbitControls | null): void {
    this.position.copy(this.camera.position);
    this.quaternion.copy(this.camera.quaternion);
    if (orbit) this.target.copy(orbit.target);
  }

  /** Move the camera back to where it may be; returns whether it was elsewhere. */
  pull(orbit: OrbitControls | null): boolean {
    const { position, quaternion } = this.camera;
    if (!this.path || (position.equals(this.position) && quaternion.equals(this.quaternion))) return false;
    const wasFar = this.path.clamp(position);
    if (wasFar && orbit) this.camera.lookAt(orbit.target);
    const isSeen = this.path.sees(this.camera);
    if (!isSeen) {
      position.copy(this.position);
      quaternion.copy(this.quaternion);
      orbit?.target.copy(this.target);
    }
    this.allow(orbit);
    return wasFar || !isSeen;
  }
}
