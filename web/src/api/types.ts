// Short names for what the contract describes.

import type { components } from './contract';

type Schemas = components['schemas'];
export type Job = Schemas['Job'];
export type Cloud = Schemas['Cloud'];
/** A label, segment or region of a medical file. */
export type Part = Schemas['SegmentationItem'];
export type Problem = Schemas['Problem'];
export type Settings = Schemas['Settings'];
export type Report = Schemas['Report'];
export type Estimate = Schemas['Estimate'];
export type DryRun = Schemas['DryRun'];
export type Warning = Schemas['Warning'];
export type Verdict = Schemas['Verdict'];
export type Status = Schemas['Status'];
export type Phase = Schemas['Phase'];
export type PresetName = Schemas['PresetName'];
export type PresetEntry = Schemas['PresetEntry'];
export type Snapshot = Schemas['Snapshot'];
export type MetricSeries = Schemas['MetricSeries'];
export type BlockSeries = Schemas['BlockSeries'];
export type GradientHistogram = Schemas['GradientHistogram'];
export type Limits = Schemas['Limits'];
export type Ready = Schemas['Ready'];
export type Version = Schemas['Version'];
export type JobPage = Schemas['JobPage'];
export type NewJob = Schemas['NewJob'];
export type JobKeep = Schemas['JobKeep'];
export type Erased = Schemas['Erased'];
export type Session = Schemas['Session'];
export type Key = Schemas['Key'];
export type KeyRequest = Schemas['KeyRequest'];
export type AuditRow = Schemas['AuditRow'];
export type AuditPage = Schemas['AuditPage'];
/** What a cloud says of its coordinates. */
export type Frame = Schemas['Frame'];
export type Unit = Schemas['Unit'];

/** What a list shows of a job: ten thousand of them stay in memory. */
export type Row = Omit<Job, 'settings' | 'links'>;
