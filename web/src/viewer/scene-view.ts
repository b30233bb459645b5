/** Drawing and navigation of Gaussians. Only files of this folder import three.js, only this one Spark. */

import { SparkControls, SparkRenderer, SplatFileType, SplatMesh } from "@sparkjsdev/spark";
import { Matrix4, PerspectiveCamera, Scene, Vector3, WebGLRenderer, WebGLRenderTarget } from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import type { StoredCamera, StoredCameras } from "../container/cameras";
import { CameraPath } from "./camera-path";
import { fit, placeAt } from "./coded-camera";
import { Leash } from "./leash";
import { overviewOf } from "./overview";
import { upOf } from "./upright";

const DILATION_PX2 = 0.3; // added to both variances of a splat, as in the reference renderer
const SPLATS = { preBlurAmount: DILATION_PX2, blurAmount: 0, maxStdDev: Math.sqrt(10), sortRadial: false };
const ORBIT_SPEED = 0.4; // 1 is a full turn for a drag over the height of the window; coded cameras are close together

const MOST_POINTS = 20_000; // that a first view is chosen by

export type Navigation = "orbit" | "fly";

/** What a view tells its page. */
export interface Listener {
  /** The camera was held back, as the coded views show no more. */
  onEdge(): void;
  onPlaying(isPlaying: boolean): void;
}

/** Draws splats. They are blended as sRGB colours in a render target, too, where Spark would blend linear ones. */
class Splats extends SparkRenderer {
  override onBeforeRender(...of: Parameters<SparkRenderer["onBeforeRender"]>): void {
    super.onBeforeRender(...of);
    this.uniforms.encodeLinear.value = false;
  }
}

/** A view of one scene of Gaussians in a canvas. */
export class SceneView {
  private readonly renderer: WebGLRenderer;
  private readonly spark: Splats;
  private readonly scene = new Scene();
  private readonly camera = new PerspectiveCamera();
  private orbit: OrbitControls | null = null;
  private readonly fly: SparkControls;
  private mesh: SplatMesh | null = null;
  private navigation: Navigation = "orbit";
  private shown: StoredCamera | null = null;
  private focus = 1; // distance of the centre of orbits from the camera
  private isStale = true; // whether something other than the camera changed since the last frame
  private readonly drawnFrom = new Matrix4();
  private waiting: (() => void)[] = [];
  private readonly up = new Vector3(0, -1, 0);
  private path: CameraPath | null = null;
  private playedFrom: number | null = null; // time of the start of the path, in ms
  private staysNear = true;
  private readonly leash = new Leash(this.camera);
  /** Set by the page. */
  listener: Listener = { onEdge: () => undefined, onPlaying: () => undefined };

  constructor(private readonly canvas: HTMLCanvasElement) {
    this.renderer = new WebGLRenderer({ canvas, antialias: false, preserveDrawingBuffer: true });
    this.spark = new Splats({ ...SPLATS, renderer: this.renderer, onDirty: () => (this.isStale = true) });
    this.scene.add(this.spark);
    this.fly = new SparkControls({ canvas });
    new ResizeObserver(() => this.resize()).observe(canvas);
    for (const event of ["pointerdown", "wheel"]) canvas.addEventListener(event, () => this.stop(), { capture: true, passive: true });
    this.renderer.setAnimationLoop(() => this.draw());
  }

  /** Set the cameras of a scene, before its Gaussians, and move to one of them. first: its index. */
  setCameras(cameras: StoredCameras, first = 0): void {
    const { near, far, views } = cameras;
    this.camera.near = 0.02 * near;
    this.camera.far = 20 * far;
    this.focus = (2 * near * far) / (near + far); // at the mean disparity
    this.fly.fpsMovement.moveSpeed = 0.3 * this.focus;
    this.fly.pointerControls.slideSpeed = 0.002 * this.focus;
    this.fly.pointerControls.scrollSpeed = 0.001 * this.focus;
    this.up.copy(upOf(views));
    this.path = this.leash.path = new CameraPath(cameras, this.focus);
    this.goTo(views[first]);
  }

  /** Move to a view of most Gaussians, whose cameras are not known; the camera may go anywhere. */
  showAll(): void {
    const { mesh } = this;
    if (!mesh) return;
    const points: Vector3[] = [];
    const every = Math.ceil((mesh.splats?.getNumSplats() ?? 0) / MOST_POINTS);
    mesh.forEachSplat((index, centre) => index % every === 0 && points.push(centre.clone().applyQuaternion(mesh.quaternion)));
    this.setCameras(overviewOf(points));
    this.path = this.leash.path = null;
  }

  /** Replace the Gaussians by those of a .ply file in the frame of the cameras, or of a .spz file with RUB axes. */
  async setGaussians(fileBytes: Uint8Array, type: "ply" | "spz"): Promise<void> {
    const fileType = type === "ply" ? SplatFileType.PLY : SplatFileType.SPZ;
    const mesh = new SplatMesh({ fileBytes, fileType });
    await mesh.initialized;
    if (type === "spz") mesh.quaternion.set(1, 0, 0, 0); // from right, up, backward to right, down, forward
    this.clear();
    this.mesh = mesh;
    this.scene.add(mesh);
    this.isStale = true;
  }

  /** Wait until the Gaussians are sorted and drawn, or the time has passed: a hidden page draws nothing. */
  async whenDrawn(mostMs: number): Promise<void> {
    await new Promise<void>((resolve) => {
      this.waiting.push(resolve);
      setTimeout(resolve, mostMs);
    });
  }

  clear(): void {
    if (!this.mesh) return;
    this.scene.remove(this.mesh);
    this.mesh.dispose();
    this.mesh = null;
    this.isStale = true;
  }

  /** Play the path through the coded cameras. Touching the canvas stops it. */
  play(): void {
    if (!this.path) return;
    this.playedFrom = performance.now() - 1000 * this.path.secondsNear(this.camera.position);
    this.listener.onPlaying(true);
  }

  stop(): void {
    if (this.playedFrom === null) return;
    this.playedFrom = null;
    this.setNavigation(this.navigation);
    this.listener.onPlaying(false);
  }

  /** Set whether the camera stays where coded cameras are near and look in about its direction. */
  setStaysNear(staysNear: boolean): void {
    this.staysNear = staysNear;
  }

  /** Move to a coded camera. */
  goTo(coded: StoredCamera): void {
    this.stop();
    this.shown = coded;
    placeAt(this.camera, coded);
    this.resize();
    this.setNavigation(this.navigation);
  }

  /** Yield what each coded camera sees. The view stays as it is. Ends early if the Gaussians are replaced. */
  async *pictures(cameras: StoredCamera[], width: number, height: number): AsyncGenerator<ImageData> {
    const { mesh } = this;
    const sorted = new SparkRenderer({ ...SPLATS, renderer: this.renderer, autoUpdate: false }); // in an order of its own
    const target = new WebGLRenderTarget(width, height);
    try {
      for (const coded of cameras) {
        const camera = new PerspectiveCamera(undefined, undefined, this.camera.near, this.camera.far);
        placeAt(camera, coded);
        fit(camera, coded, width, height);
        camera.updateMatrixWorld();
        await sorted.update({ scene: this.scene, camera });
        if (this.mesh !== mesh) return;
        this.renderer.setRenderTarget(target);
        sorted.render(this.scene, camera);
        this.renderer.setRenderTarget(null);
        yield await this.read(target);
      }
    } finally {
      target.dispose();
      sorted.dispose();
    }
  }

  private async read(target: WebGLRenderTarget): Promise<ImageData> {
    const { width, height } = target;
    const upwards = new Uint8Array(4 * width * height); // rows from the bottom to the top
    await this.renderer.readRenderTargetPixelsAsync(target, 0, 0, width, height, upwards);
    const image = new ImageData(width, height);
    for (let row = 0; row < height; row++) {
      image.data.set(upwards.subarray(4 * width * row, 4 * width * (row + 1)), 4 * width * (height - 1 - row));
    }
    for (let alpha = 3; alpha < image.data.length; alpha += 4) image.data[alpha] = 255;
    return image;
  }

  setNavigation(navigation: Navigation): void {
    this.navigation = navigation;
    this.fly.fpsMovement.enable = navigation === "fly";
    this.fly.pointerControls.enable = navigation === "fly";
    this.orbit?.dispose();
    this.orbit = navigation === "orbit" ? this.orbitAhead() : null;
    this.leash.allow(this.orbit);
  }

  /** Return controls that orbit around a point ahead, level. They take the camera's up vector when they are made. */
  private orbitAhead(): OrbitControls {
    this.camera.up.copy(this.up);
    const { position, quaternion } = this.camera.clone();
    const controls = new OrbitControls(this.camera, this.canvas); // turns the camera to the origin
    this.camera.position.copy(position);
    this.camera.quaternion.copy(quaternion);
    const ahead = this.camera.getWorldDirection(new Vector3());
    controls.rotateSpeed = ORBIT_SPEED;
    controls.target.copy(position).addScaledVector(ahead, this.focus);
    controls.listenToKeyEvents(window);
    return controls;
  }

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width === 0 || height === 0) return;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.renderer.setSize(width, height, false);
    if (this.shown) fit(this.camera, this.shown, width, height);
    this.camera.updateProjectionMatrix();
    this.isStale = true;
  }

  /** Draw if the last frame is out of date. */
  private draw(): void {
    if (this.playedFrom !== null) this.movePlaying((performance.now() - this.playedFrom) / 1000);
    else if (this.navigation === "fly") this.fly.update(this.camera);
    this.holdBack();
    this.camera.updateMatrixWorld();
    if (this.isStale || !this.drawnFrom.equals(this.camera.matrixWorld)) {
      this.isStale = false; // before drawing, which can make the next frame necessary
      this.drawnFrom.copy(this.camera.matrixWorld);
      this.renderer.render(this.scene, this.camera);
    }
    if (this.mesh && this.isUpToDate()) this.waiting.splice(0).forEach((resolve) => resolve());
  }

  private movePlaying(seconds: number): void {
    if (!this.path || !this.shown) return;
    const { position, quaternion, intrinsics } = this.path.at(seconds);
    this.camera.position.copy(position);
    this.camera.quaternion.copy(quaternion);
    this.shown = { ...this.shown, intrinsics };
    fit(this.camera, this.shown, this.canvas.clientWidth, this.canvas.clientHeight);
    this.camera.updateProjectionMatrix();
  }

  private holdBack(): void {
    if (this.playedFrom !== null || !this.staysNear) this.leash.allow(this.orbit);
    else if (this.leash.pull(this.orbit)) this.listener.onEdge();
  }

  /** Return whether the last frame shows the Gaussians as they are, sorted for its camera. */
  private isUpToDate(): boolean {
    const { dirty, sorting, sortDirty, updateTimeoutId, activeSplats } = this.spark;
    return !this.isStale && !dirty && !sorting && !sortDirty && updateTimeoutId === -1 && activeSplats > 0;
  }
}
