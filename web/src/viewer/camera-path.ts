/** A path through the coded cameras, and how far from it the camera may move. */

import { PerspectiveCamera, Quaternion, Vector3 } from "three";
import type { StoredCamera, StoredCameras } from "../container/cameras";
import { placeAt } from "./coded-camera";

const SECONDS_PER_CAMERA = 2.5;
const REACH = 0.15; // how far the camera may be from the path, relative to the distance of the scene
const MOST_TURN = (25 * Math.PI) / 180; // how far its view may be turned from that of a coded camera nearby
const SWAY = 0.04; // of the path of a single camera, relative to the distance of the scene

export interface Pose {
  position: Vector3;
  quaternion: Quaternion;
}

export interface Stop extends Pose {
  /** fx, fy, cx, cy as those of coded cameras. */
  intrinsics: number[];
}

/** A path forth and back through all coded cameras, each followed by the nearest of the rest. */
export class CameraPath {
  private readonly stops: Stop[];
  private readonly gap: number; // longest distance of neighbours
  private readonly reach: number;

  /** focus: distance of the scene from the cameras. */
  constructor({ views }: StoredCameras, private readonly focus: number) {
    this.stops = orderOf(views).map((view) => stopAt(views[view]));
    const gaps = this.stops.slice(1).map(({ position }, at) => position.distanceTo(this.stops[at].position));
    this.gap = Math.max(0, ...gaps);
    this.reach = Math.max(REACH * focus, this.gap / 2);
  }

  /** Return the stop after this many seconds of the path, which starts and ends slowly. */
  at(seconds: number): Stop {
    const last = this.stops.length - 1;
    const turn = (Math.PI * seconds) / (SECONDS_PER_CAMERA * Math.max(last, 1));
    return last === 0 ? this.swayed(turn) : this.between(((1 - Math.cos(turn)) / 2) * last);
  }

  /** Return the seconds at which the path is at a stop nearest to a position. */
  secondsNear(position: Vector3): number {
    const last = this.stops.length - 1;
    if (last === 0) return 0;
    const distances = this.stops.map((stop) => stop.position.distanceTo(position));
    const nearest = distances.indexOf(Math.min(...distances));
    return (Math.acos(1 - (2 * nearest) / last) / Math.PI) * SECONDS_PER_CAMERA * last;
  }

  /** Move a position to the nearest one within reach of the path; returns whether it was outside. */
  clamp(position: Vector3): boolean {
    const nearest = this.nearestTo(position);
    if (nearest.distanceTo(position) <= this.reach) return false;
    position.sub(nearest).setLength(this.reach).add(nearest);
    return true;
  }

  /** Return whether a coded camera near the position looks in about this direction. */
  sees({ position, quaternion }: Pose): boolean {
    const nearby = this.reach + this.gap;
    const turns = this.stops
      .filter((stop) => stop.position.distanceTo(position) <= nearby)
      .map((stop) => ahead(stop.quaternion).angleTo(ahead(quaternion)));
    return Math.min(...turns) <= MOST_TURN;
  }

  private nearestTo(position: Vector3): Vector3 {
    const points = this.stops.map((stop, at) => onSegment(position, stop.position, this.stops[Math.max(at - 1, 0)].position));
    return points.reduce((best, point) => (point.distanceTo(position) < best.distanceTo(position) ? point : best));
  }

  private between(time: number): Stop {
    const [before, start, end, after] = [-1, 0, 1, 2].map((step) => this.stop(Math.min(Math.floor(time), this.stops.length - 2) + step));
    const t = time - Math.min(Math.floor(time), this.stops.length - 2);
    const coordinate = (axis: "x" | "y" | "z") =>
      catmullRom(before.position[axis], start.position[axis], end.position[axis], after.position[axis], t);
    return {
      position: new Vector3(coordinate("x"), coordinate("y"), coordinate("z")),
      quaternion: start.quaternion.clone().slerp(end.quaternion, t),
      intrinsics: start.intrinsics.map((value, at) => value + t * (end.intrinsics[at] - value)),
    };
  }

  /** Return a stop on a small circle around the only camera, which looks at the middle of the scene. */
  private swayed(turn: number): Stop {
    const { position, quaternion, intrinsics } = this.stops[0];
    const offset = new Vector3(Math.sin(turn), (1 - Math.cos(turn)) / 2, 0).multiplyScalar(SWAY * this.focus);
    const camera = new PerspectiveCamera();
    camera.up.set(0, 1, 0).applyQuaternion(quaternion);
    camera.position.copy(offset.applyQuaternion(quaternion).add(position));
    camera.lookAt(ahead(quaternion).multiplyScalar(this.focus).add(position));
    return { position: camera.position, quaternion: camera.quaternion, intrinsics };
  }

  private stop(index: number): Stop {
    return this.stops[Math.min(Math.max(index, 0), this.stops.length - 1)];
  }
}

/** Return the index of the coded camera nearest to all others, the first of several. */
export function middleOf(views: StoredCamera[]): number {
  const sums = views.map((view) => views.reduce((sum, other) => sum + distance(view, other), 0));
  return sums.findIndex((sum) => sum <= Math.min(...sums) * (1 + 1e-6));
}

/** Return the indices of the cameras from one end, each followed by the nearest of the rest. */
function orderOf(views: StoredCamera[]): number[] {
  const sums = views.map((view) => views.reduce((sum, other) => sum + distance(view, other), 0));
  const order = [sums.indexOf(Math.max(...sums))];
  while (order.length < views.length) {
    const rest = views.map((_, view) => view).filter((view) => !order.includes(view));
    const last = views[order[order.length - 1]];
    order.push(rest.reduce((best, view) => (distance(last, views[view]) < distance(last, views[best]) ? view : best)));
  }
  return order;
}

function distance(first: StoredCamera, second: StoredCamera): number {
  return Math.hypot(...first.centre.map((value, axis) => value - second.centre[axis]));
}

function stopAt(coded: StoredCamera): Stop {
  const camera = new PerspectiveCamera();
  placeAt(camera, coded);
  return { position: camera.position, quaternion: camera.quaternion, intrinsics: coded.intrinsics };
}

function ahead(quaternion: Quaternion): Vector3 {
  return new Vector3(0, 0, -1).applyQuaternion(quaternion);
}

function onSegment(position: Vector3, start: Vector3, end: Vector3): Vector3 {
  const along = end.clone().sub(start);
  const share = along.lengthSq() > 0 ? position.clone().sub(start).dot(along) / along.lengthSq() : 0;
  return start.clone().addScaledVector(along, Math.min(Math.max(share, 0), 1));
}

function catmullRom(before: number, start: number, end: number, after: number, t: number): number {
  const [linear, square, cube] = [end - before, 2 * before - 5 * start + 4 * end - after, 3 * (start - end) + after - before];
  return start + 0.5 * t * (linear + t * (square + t * cube));
}
