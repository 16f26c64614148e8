/** Refresh that each flip fell on, and missed refreshes, as `study_app/pacing.py` defines it. */
export type FlipKind = "first" | "on-time" | "late" | "missed" | "doubled";

export interface Flip {
  /** Its stamp. */
  readonly t_s: number;
  /** Refreshes since the flip before; 0 for a doubled one, 1 in time. */
  readonly refreshes: number;
  readonly kind: FlipKind;
  /** Behind the grid line of its refresh. */
  readonly late_s: number;
}

const LATE_SHARE = 0.15;
const FOLLOW_SHARE = 0.1;

/** Judges flips one by one against the grid of refreshes. */
export class Pacer {
  private readonly period_s: number;
  private line_s: number | null = null; // grid line of the flip before

  constructor(refresh_hz: number) {
    this.period_s = 1 / refresh_hz;
  }

  flip(t_s: number): Flip {
    if (this.line_s === null) {
      this.line_s = t_s;
      return { t_s, refreshes: 0, kind: "first", late_s: 0 };
    }
    const since = (t_s - this.line_s) / this.period_s;
    const refreshes = roundHalfEven(since);
    if (refreshes < 0) throw new Error(`flip stamps must not run backwards (got ${t_s} s)`);
    const behind = since - refreshes;
    this.line_s += refreshes * this.period_s;
    const late = behind >= LATE_SHARE;
    if (!late && refreshes) this.line_s += behind * this.period_s * FOLLOW_SHARE;
    const kind =
      refreshes === 0 ? "doubled" : refreshes > 1 ? "missed" : late ? "late" : "on-time";
    return { t_s, refreshes, kind, late_s: behind * this.period_s };
  }
}

/** The nearest whole number, of two as near the even one, as Python rounds. */
function roundHalfEven(value: number): number {
  const down = Math.floor(value);
  const rest = value - down;
  const up = rest > 0.5 || (rest === 0.5 && down % 2 !== 0);
  return up ? down + 1 : down;
}
