// The cloud of a job, as long as it is there.

import { useEffect, useState } from 'preact/hooks';
import { get } from '../api/client';
import type { Cloud, Job } from '../api/types';

export function useCloud(job: Job): Cloud | null {
  const [cloud, setCloud] = useState<Cloud | null>(null);
  const { cloud: address } = job.links;
  useEffect(() => {
    if (address) get<Cloud>(address).then(setCloud, () => undefined);
  }, [address]);
  return cloud;
}
