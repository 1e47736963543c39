// Numbers and times for people.

import type { Unit } from './api/types';

const whole = new Intl.NumberFormat('en', { maximumFractionDigits: 0 });

export function count(value: number): string {
  return whole.format(value);
}

/** A count with its noun, which gets an s. */
export function many(value: number, noun: string): string {
  return `${count(value)} ${noun}${value === 1 ? '' : 's'}`;
}

/** Four significant digits, without the noise of more. */
export function number(value: number | null | undefined): string {
  if (value === null || value === undefined) return '–';
  if (value !== 0 && (Math.abs(value) >= 1e6 || Math.abs(value) < 1e-4)) return value.toExponential(2);
  return Number(value.toPrecision(4)).toLocaleString('en', { maximumSignificantDigits: 4 });
}

const POWERS = ['', '', '²', '³'];

/** A length, an area or a volume in its unit, where that is known. */
export function measure(value: number | null | undefined, unit: Unit | null | undefined, power: 1 | 2 | 3 = 1): string {
  if (value === null || value === undefined || !unit || unit === 'unknown') return number(value);
  // As people of medicine say it.
  if (unit === 'mm' && power === 3 && value >= 1000) return `${number(value / 1000)} ml`;
  return `${number(value)} ${unit}${POWERS[power]}`;
}

export function percent(share: number): string {
  return `${Math.floor(share * 100)} %`;
}

const UNITS = ['bytes', 'kB', 'MB', 'GB', 'TB'];

export function bytes(value: number): string {
  let unit = 0;
  let scaled = value;
  while (scaled >= 1000 && unit < UNITS.length - 1) {
    scaled /= 1000;
    unit += 1;
  }
  return `${unit > 0 && scaled < 10 ? scaled.toFixed(1) : Math.round(scaled)} ${UNITS[unit]}`;
}

export function duration(seconds: number): string {
  if (seconds < 10) return `${seconds.toFixed(1)} s`;
  if (seconds < 60) return `${Math.round(seconds)} s`;
  const minutes = Math.round(seconds / 60);
  if (minutes < 60) return `${minutes} min`;
  const hours = Math.floor(minutes / 60);
  return hours < 48 ? `${hours} h ${minutes % 60} min` : `${Math.round(hours / 24)} days`;
}

/** Roughly: nobody counts the seconds of an estimate. */
export function remaining(seconds: number): string {
  return seconds < 1 ? 'nearly done' : `about ${duration(Math.max(1, Math.round(seconds))).replace('.0', '')} left`;
}

/** When a job that waits will have ended, roughly. */
export function until(seconds: number): string {
  return `done in about ${duration(Math.max(1, Math.round(seconds))).replace('.0', '')}`;
}

const clock = new Intl.DateTimeFormat(undefined, { hour: '2-digit', minute: '2-digit' });
const day = new Intl.DateTimeFormat(undefined, { day: 'numeric', month: 'short', hour: '2-digit', minute: '2-digit' });

/** Local time; the day where it is not today. */
export function local(time: string): string {
  const date = new Date(time);
  return date.toDateString() === new Date().toDateString() ? clock.format(date) : day.format(date);
}

const date = new Intl.DateTimeFormat(undefined, { day: 'numeric', month: 'short' });
const dateOfYear = new Intl.DateTimeFormat(undefined, { month: 'short', year: 'numeric' });

/** The time where it is today, else the day, else the month: the farther away, the less of it counts. */
export function soon(time: string): string {
  const [at, now] = [new Date(time), new Date()];
  if (at.toDateString() === now.toDateString()) return clock.format(at);
  return Math.abs(at.getTime() - now.getTime()) < 300 * 86_400_000 ? date.format(at) : dateOfYear.format(at);
}

export function between(from: string, to: string): number {
  return (Date.parse(to) - Date.parse(from)) / 1000;
}
