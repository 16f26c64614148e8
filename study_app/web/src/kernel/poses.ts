/** Poses of a participant's head, as `protocols/browser/head_poses.py` defines them. */

/** The head's unit quaternion, times 32767; all 0 where it was not tracked. */
export type Pose = readonly [x: number, y: number, z: number, w: number];

const WHOLE = 32767;
export const UNTRACKED: Pose = [0, 0, 0, 0];

export function poseOf({ x, y, z, w }: { x: number; y: number; z: number; w: number }): Pose {
  const whole = (part: number) => Math.floor(WHOLE * part + 0.5);
  return [whole(x), whole(y), whole(z), whole(w)];
}

/** True if the head points farther from straight ahead than so many degrees. */
export function turnedAway([x, y]: Pose, most_deg: number): boolean {
  return x * x + y * y > (WHOLE * Math.sin((Math.PI * most_deg) / 360)) ** 2;
}

/** Poses as a line has them. */
export function encoded(poses: readonly Pose[]): string {
  const bytes = new DataView(new ArrayBuffer(8 * poses.length));
  poses.flat().forEach((part, index) => {
    bytes.setInt16(2 * index, part, true);
  });
  return btoa(Array.from(new Uint8Array(bytes.buffer), (byte) => String.fromCharCode(byte)).join(""));
}
